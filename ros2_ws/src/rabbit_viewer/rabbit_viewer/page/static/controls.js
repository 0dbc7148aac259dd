// What a person chooses of a played walk, made of the server's description; and the link that holds it.

const AS_IT_IS = "default"; // a link with nothing else

export class Controls {
  constructor(section, send) {
    this.section = section;
    this.send = send;
    this.fields = new Map();
    this.groups = new Map();
    this.state = null;
    this.isLinked = false;
  }

  build({controls: description, options, pushes}) {
    this.options = options;
    this.defaults = Object.fromEntries(description.map((control) => [control.name, control.default]));
    if (this.fields.size) return;
    this.section.hidden = false;
    this.section.append(this.actions(pushes));
    const grouped = (control) => Number(Boolean(control.group)); // what opens comes last
    for (const control of [...description].sort((one, other) => grouped(one) - grouped(other))) this.place(control.group).append(this.field(control));
  }

  // the section, or a part of it that opens
  place(group) {
    if (!group) return this.section;
    if (!this.groups.has(group)) {
      const details = document.createElement("details");
      const inside = document.createElement("div"); // a grid on `details` itself is one column in Chromium
      details.append(Object.assign(document.createElement("summary"), {textContent: group}), inside);
      this.section.append(details);
      this.groups.set(group, inside);
    }
    return this.groups.get(group);
  }

  actions(pushes) {
    const box = Object.assign(document.createElement("div"), {className: "wide"});
    const button = (id, text, title, message) => {
      const made = Object.assign(document.createElement("button"), {id, textContent: text, title});
      made.onclick = () => this.send(message());
      box.append(made);
      return made;
    };
    this.pause = button("pause", "Pause", "hold, go on (space)", () => ({do: "pause", paused: !this.state.paused}));
    button("tick", "Tick", "one tick (.)", () => ({do: "tick"}));
    button("reset", "Reset", "again, with these settings (r)", () => ({do: "reset"}));
    button("next", "Next course", "another course (n)", () => this.another());
    if (pushes) {
      button("push-back", "Push back", "(left)", () => ({do: "push", force: -this.force, seconds: 0.1}));
      button("push-on", "Push on", "(right)", () => ({do: "push", force: this.force, seconds: 0.1}));
      box.append(this.slider("force", "push", 20, 600, 20, 200, "N", () => {}));
    }
    box.append(this.slider("speed", "speed", 0.05, 2, 0.05, 1, "x", (value) => this.send({do: "speed", speed: value})));
    return box;
  }

  get force() {
    return Number(this.section.querySelector("#force").value);
  }

  // a message with all settings, of one that names some
  whole(message) {
    return message.settings ? {...message, settings: {...this.state.settings, ...message.settings}} : message;
  }

  another() {
    return {do: "begin", settings: {...this.state.settings, seed: (this.state.settings.seed + 1) % 2 ** 31}};
  }

  slider(name, title, min, max, step, value, unit, onchange) {
    const label = document.createElement("label"), output = document.createElement("output");
    const input = Object.assign(document.createElement("input"), {type: "range", id: name, min, max, step, value});
    const show = () => { output.textContent = `${Number(input.value)} ${unit}`.trim(); };
    input.oninput = show;
    input.onchange = () => onchange(Number(input.value));
    label.append(title, output, input);
    show();
    return Object.assign(label, {show, input});
  }

  field({name, title, enum: choices, minimum, maximum, step = 1, unit = "", when}) {
    const change = (value) => this.set(name, value);
    let label;
    if (choices) {
      label = document.createElement("label");
      const input = Object.assign(document.createElement("select"), {id: name});
      input.append(...choices.map((choice) => new Option(choice, choice)));
      input.onchange = () => change(input.value);
      label.append(title, document.createElement("output"), input);
      Object.assign(label, {show() {}, input});
    } else if (maximum > 1000) {
      label = document.createElement("label");
      const input = Object.assign(document.createElement("input"), {type: "number", id: name, min: minimum, max: maximum, step});
      input.onchange = () => change(Number(input.value));
      label.append(title, document.createElement("output"), input);
      Object.assign(label, {show() {}, input});
    } else {
      label = this.slider(name, title, minimum, maximum, step, minimum, unit, change);
    }
    label.title = when === "now" ? "acts at once" : "acts from the next reset";
    this.fields.set(name, label);
    return label;
  }

  set(name, value) {
    this.send({do: "set", settings: {...this.state.settings, [name]: value}});
  }

  show(state) {
    this.state = state;
    this.pause.textContent = state.paused ? "Go on" : "Pause";
    this.pause.setAttribute("aria-pressed", state.paused);
    const speed = this.section.querySelector("#speed");
    if (document.activeElement !== speed) { speed.value = state.speed; speed.oninput(); }
    for (const [name, label] of this.fields) {
      label.input.value = state.settings[name];
      label.show();
      label.classList.toggle("waiting", state.waiting.includes(name));
    }
    if (this.isLinked) history.replaceState(null, "", this.link());
  }

  // begins again with the settings of the link in the address bar, if they are others; what the link alone cannot bring
  follow() {
    const known = this.state.settings, {settings, options} = fromLink(location.hash, this.defaults);
    const wanted = location.hash ? {...this.defaults, ...settings} : known;
    this.isLinked = true;
    if (this.toLink(wanted, "") !== this.toLink(known, "")) this.send({do: "begin", settings: wanted});
    else history.replaceState(null, "", this.link());
    if (!location.hash || (options === this.options && !options.includes("--learn"))) return "";
    const command = (words) => `"rabbit play${words && ` ${words}`}"`;
    const policy = options.includes("--learn") ? "; what was learned there is not in it" : "";
    return `this link is of ${command(options)}, this page of ${command(this.options)}${policy}: the walk may differ`;
  }

  link() {
    return `${location.pathname}#${this.toLink(this.state.settings, this.options) || AS_IT_IS}`;
  }

  // what differs from the default
  toLink(settings, options) {
    const words = new URLSearchParams(Object.entries(settings).filter(([name, value]) => value !== this.defaults[name]));
    if (options) words.set("options", options);
    return words.toString();
  }
}

function fromLink(hash, defaults) {
  const {options = "", [AS_IT_IS]: _, ...settings} = Object.fromEntries(new URLSearchParams(hash.slice(1)));
  for (const [name, value] of Object.entries(settings)) if (typeof defaults[name] === "number" && value !== "" && Number.isFinite(Number(value))) settings[name] = Number(value);
  return {settings, options};
}
