// What may be asked of a running graph, where its viewer passes it on.

export class GraphControls {
  constructor(section, send) {
    this.section = section;
    this.send = send;
    this.phase = "";
  }

  build() {
    if (!this.section.hidden) return;
    this.section.hidden = false;
    const box = Object.assign(document.createElement("div"), {className: "wide"});
    const seed = Object.assign(document.createElement("input"), {type: "number", id: "seed", min: 0, value: 1});
    const path = Object.assign(document.createElement("input"), {type: "text", id: "policy", placeholder: "policy: a file of the controller's machine"});
    seed.setAttribute("aria-label", "seed");
    path.setAttribute("aria-label", "policy");
    this.pause = this.button("pause", "Pause", () => ({do: "pause", paused: this.phase !== "paused"}));
    const reset = this.button("reset", "Reset", () => ({do: "reset", seed: Number(seed.value)}));
    const load = this.button("load", "Load policy", () => ({do: "load", path: path.value}));
    box.append(this.pause, reset, "seed", seed, path, load);
    this.section.append(box);
  }

  button(id, text, message) {
    return Object.assign(document.createElement("button"), {id, textContent: text, onclick: () => this.send(message())});
  }

  show({phase}) {
    this.phase = phase;
    if (this.pause) this.pause.textContent = phase === "paused" ? "Go on" : "Pause";
  }
}
