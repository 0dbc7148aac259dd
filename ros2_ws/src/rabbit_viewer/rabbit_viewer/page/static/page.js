// The page: words and rows come in, pictures go out. Read this file first.

import {Clock} from "clock";
import {Controls} from "controls";
import {GraphControls} from "graph";
import {showLearning} from "learning";
import {Plots} from "plots";
import {Picture, Scene} from "scene";
import {open} from "source";
import {Story} from "story";
import {onTheme, toggle} from "theme";
import {MARKS, Timeline} from "timeline";
import {Walk} from "walk";

const PLOTS_EVERY = 100; // ms
const READING = 1200; // ms, from the first picture to the walk
const KEYS = {
  " ": ["hold or go on", "pause", "play"], ".": ["one tick", "tick", "on"], r: ["reset", "reset"], n: ["next course", "next"],
  ArrowLeft: ["push back; a tick back", "push-back", "back"], ArrowRight: ["push on; a tick on", "push-on", "on"],
  f: ["follow the walk", "live"], "+": ["faster", null], "-": ["slower", null], l: ["copy the link", "link"], d: ["dark or light", "theme"], "?": ["keys", "help"],
};
const by = (id) => document.getElementById(id);

const state = {walk: null, scenes: [], ended: {}, isDirty: false, plotted: 0, last: 0, pictures: 0, refused: 0, words: {}};

const source = open({word, rows, connected});
const clock = new Clock();
const plots = new Plots(by("plots"), clock);
const timeline = new Timeline(by("timeline"), clock, () => explain(plots.chosen, clock.row));
const controls = new Controls(by("controls"), act);
const story = new Story(by("story"), (message) => (message.do === "explain" ? explainFall() : act(controls.whole(message))));
const graph = new GraphControls(by("controls"), (message) => source.send(message));

function word(message) {
  state.words[message.type] = message;
  queueMicrotask(() => (HANDLERS[message.type] ?? (() => {}))(message)); // after what is made below
}

const HANDLERS = {
  about: begin,
  state(message) {
    if (!source.isLive) return;
    controls.show(message);
    by("link").hidden = false;
    if (!controls.isLinked) follow();
  },
  ended(message) {
    state.ended = message.walkers;
    state.isDirty = true;
  },
  refused({text}) {
    state.refused += 1;
    notice(text, "alert");
  },
  explained({walker, tick, lines}) {
    if (state.asked !== `${walker} ${tick}`) return;
    showWhy(lines.join("\n"));
  },
  learning: (message) => showLearning(by("learning"), message),
  graph(message) {
    graph.show(message);
    by("status").textContent = message.phase;
  },
  swap: ({tick, version}) => notice(`policy ${version} from tick ${tick} on`),
  note: ({text}) => notice(text),
};

function begin(about) {
  state.walk = new Walk(about);
  state.ended = {};
  by("title").textContent = about.title ?? "";
  document.title = `RABBIT ${about.title ?? ""}`;
  by("scenes").replaceChildren();
  state.scenes = state.walk.walkers.map((walker) => new ("shapes" in walker.about ? Picture : Scene)(by("scenes"), walker));
  clock.begin(state.walk, source.isLive && about.mode !== "recording", about.mode !== "graph");
  story.begin(about);
  showWhy("");
  timeline.begin();
  plots.begin(state.walk);
  if (about.controls && source.isLive) controls.build(about);
  legend();
  if (about.control && source.isLive) graph.build();
}

function rows(buffer) {
  queueMicrotask(() => state.walk?.add(buffer));
}

function connected(is) {
  by("status").textContent = is ? "" : "no connection";
  state.isWatching = false;
  if (is) by("notice").hidden = true;
}

// asks for something that changes the walk: it is to be seen at once
function act(message) {
  if (["push", "pause", "tick", "speed"].includes(message.do)) clock.follow();
  source.send(message);
}

function explain(walker, row) {
  if (!source.isLive || !("explains" in state.walk.about)) return;
  const tick = state.walk.walkers[walker].get(row, "tick");
  state.asked = `${walker} ${tick}`;
  source.send({do: "explain", walker, tick});
}

// the tick that the server names, of the first robot that fell
function explainFall() {
  const walker = Object.values(state.ended).findIndex((ended) => ended.tick !== undefined);
  if (walker < 0) return;
  story.show(state.walk.walkers.map((_, i) => (i === walker ? state.ended[i] : null)));
  clock.seek(state.walk.walkers[walker].rowOf(state.ended[walker].tick));
  explain(walker, clock.row);
}

// shows a text over the lower part of the window, where the scenes then have less room; hides an empty one
function showWhy(text) {
  const parts = text.split("\n\n").map((part) => {
    const shown = Object.assign(document.createElement("p"), {textContent: `${part}\n`});
    shown.classList.toggle("rows", part.startsWith("row "));
    return shown;
  });
  by("why").querySelector("pre").replaceChildren(...parts);
  by("why").hidden = !text;
  state.isDirty = true;
}

function notice(text, role = "status", seconds = 6) {
  Object.assign(by("notice"), {textContent: text, hidden: false, role});
  clearTimeout(state.timer);
  state.timer = setTimeout(() => { by("notice").hidden = true; }, 1000 * seconds);
}

function follow() {
  const missing = controls.follow();
  if (missing) notice(missing, "alert", 60);
}

function picture(now) {
  requestAnimationFrame(picture);
  const moved = clock.advance(now - state.last);
  state.last = now;
  if (clock.row < 0 || !(moved || state.isDirty || clock.row !== state.drawn)) return;
  const endings = state.scenes.map((_, i) => ending(i, clock.row));
  state.scenes.forEach((scene, i) => {
    scene.slope = controls.state?.settings.slope;
    scene.draw(clock.row, endings[i]);
  });
  story.show(endings);
  timeline.draw();
  if (now - state.plotted > PLOTS_EVERY || state.isDirty || !moved) {
    plots.draw();
    state.plotted = now;
  }
  state.drawn = clock.row;
  state.isDirty = false;
  state.pictures += 1;
  if (!state.isWatching) { // pictures are drawn only where they are seen
    state.isWatching = true;
    setTimeout(() => state.walk.about.mode === "play" && source.send({do: "watch"}), READING);
  }
}

// how a walker ended, from its last tick on
function ending(i, row) {
  const walker = state.walk.walkers[i], ended = state.ended[i];
  const isOver = row === state.walk.length - 1 || walker.get(row + 1, "tick") === walker.get(row, "tick");
  return isOver && ended?.outcome ? ended : null;
}

function legend() {
  const items = [["stance", "stance leg, thick"], ["swing", "swing leg, dashed"], ["next", "next stone"], ["area", "both barriers allow the swing foot"], ["cone", "friction cone"], ["force", "ground force"]];
  const isWalk = !state.walk?.walkers.some(({about}) => "shapes" in about);
  const marks = Object.entries(MARKS).filter(([kind]) => isWalk || kind === "saturated").map(([, [name, text]]) => [name, text, "mark"]);
  by("legend").replaceChildren(...[...(isWalk ? items : []), ...marks].map(([name, text, kind = ""]) => {
    const item = document.createElement("span"), box = document.createElement("i");
    box.className = kind;
    box.style.background = `var(--${name})`;
    item.append(box, text);
    return item;
  }));
}

function key(event) {
  if (event.key === "Escape") showWhy("");
  if (event.ctrlKey || event.altKey || event.metaKey || !(event.key in KEYS)) return;
  if (/^(SELECT|TEXTAREA)$/.test(event.target.tagName) || /^(number|text)$/.test(event.target.type)) return;
  if (event.target.type === "range" && event.key.startsWith("Arrow")) return;
  event.preventDefault();
  if (event.key === "+" || event.key === "-") return faster(event.key === "+" ? 2 : 0.5);
  const [, ...ids] = KEYS[event.key];
  ids.map(by).find((button) => button)?.click();
}

function faster(factor) {
  const speed = controls.state?.speed;
  if (speed) source.send({do: "speed", speed: Math.min(Math.max(speed * factor, 0.0625), 4)});
  else clock.rate *= factor;
}

by("save").hidden = !source.isLive;
by("why").querySelector("button").onclick = () => showWhy("");
by("theme").onclick = toggle;
by("help").onclick = () => by("keys").showModal();
by("link").onclick = () => navigator.clipboard?.writeText(location.href).then(() => notice("the link is copied"), () => notice(location.href));
by("keys").querySelector("table").append(...Object.entries(KEYS).map(([name, [text]]) => {
  const line = document.createElement("tr"), cell = document.createElement("td"), letter = Object.assign(document.createElement("kbd"), {textContent: name === " " ? "space" : name});
  cell.append(letter);
  line.append(cell, Object.assign(document.createElement("td"), {textContent: text}));
  return line;
}));
addEventListener("keydown", key);
addEventListener("hashchange", () => controls.state && follow()); // another link in the address bar
addEventListener("resize", () => { state.isDirty = true; });
onTheme(() => { state.isDirty = true; });
legend();
requestAnimationFrame(picture);
window.rabbit = {state, clock, controls, plots, source}; // for tests, and for the curious
