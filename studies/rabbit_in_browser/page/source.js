// Plays the walk in the page itself, in place of the server of `rabbit play`: the same words and rows, as play/player.py.

import {load} from "./load.js";
import {takePolicy} from "./policy.js";
import {Robot} from "./robot.js";

const STEP = 4, STATE_EVERY = 30, BEHIND = 250; // ms
const AGAIN_TICKS = 200; // after the end, before the next episode
const ROBOTS = ["first", "second"];

export function open(on) {
  on.connected(true);
  const player = new Player(on);
  player.begin().catch((error) => { document.getElementById("truth").textContent = `The walk cannot start: ${error.message}.`; });
  return {isLive: true, send: (message) => player.take(message), player};
}

// a file of the page; large ones are compressed, and some servers unpack them themselves
export async function read(name) {
  const answer = await fetch(new URL(name, import.meta.url));
  if (!answer.ok) throw new Error(`${name}: ${answer.status} ${answer.statusText}`);
  const bytes = await answer.arrayBuffer(), [first, second] = new Uint8Array(bytes);
  if (first !== 0x1f || second !== 0x8b) return bytes;
  return new Response(new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"))).arrayBuffer();
}

class Player {
  constructor(on) {
    Object.assign(this, {on, robots: [], isPaused: false, speed: 1, isResetDue: false, hasChanged: false, ticks: 0});
  }

  async begin() {
    this.parts = await load(read);
    this.controls = this.parts.numbers.controls;
    this.chosen = Object.fromEntries(this.controls.map((each) => [each.name, each.default]));
    this.reset();
    addEventListener("dragover", (event) => event.preventDefault());
    addEventListener("drop", (event) => this.drop(event));
    this.due = this.shown = performance.now();
    setInterval(() => this.go(performance.now()), STEP);
  }

  get isMoving() {
    return !this.isPaused && (this.afterEnd === 0 || this.chosen.again !== "wait");
  }

  reset() {
    for (const robot of this.robots) robot.close();
    this.settings = {...this.chosen};
    const names = ROBOTS.filter((place) => this.settings[place] !== "none");
    this.robots = names.map((place) => Object.assign(new Robot(this.parts, this.settings[place], this.settings, this.settings[`${place}_eps`]), {place}));
    Object.assign(this, {afterEnd: 0, tickOfWalk: 0, isResetDue: false, hasChanged: true});
    this.on.word({
      type: "about", mode: "play", title: `course ${this.settings.seed}`, stones: this.parts.numbers.plant.stones,
      tick_seconds: this.parts.numbers.plant.tick_seconds, walkers: this.robots.map((robot) => robot.about),
      controls: this.controls, options: "", pushes: true,
    });
    this.sayTruth();
  }

  take(message) {
    try {
      ({set: () => this.set(message.settings), reset: () => { this.isResetDue = true; }, pause: () => { this.isPaused = message.paused; },
        begin: () => { this.chosen = this.checked(message.settings); this.isResetDue = true; },
        tick: () => { this.isPaused = true; this.tick(); }, speed: () => { this.speed = message.speed; },
        push: () => this.robots.forEach((robot) => robot.push(message.force, message.seconds)),
        watch: () => {}})[message.do](); // it walks from the first picture on, whoever looks
    } catch (error) {
      this.refuse(error);
    }
    if (this.isResetDue && !this.isMoving) this.reset();
    this.hasChanged = true;
  }

  // of a control or of the link in the address bar
  checked(settings) {
    for (const {name, enum: choices, minimum, maximum} of this.controls) {
      const value = settings[name];
      const fits = choices ? choices.includes(value) : Number.isFinite(value) && value >= minimum && value <= maximum;
      const whole = name !== "seed" || Number.isInteger(value);
      if (!fits || !whole) throw new Error(`${name} = ${value}: expected ${choices ? choices.join(", ") : `${minimum} to ${maximum}`}`);
    }
    return Object.fromEntries(this.controls.map(({name}) => [name, settings[name]]));
  }

  // what needs no reset acts at once
  set(wanted) {
    const {controllers} = this.parts.numbers, settings = this.checked(wanted), old = this.chosen;
    for (const place of ROBOTS) { // another controller comes with its own gain
      if (settings[place] !== old[place] && settings[place] !== "none") settings[`${place}_eps`] = controllers[settings[place]].about.eps;
    }
    this.chosen = settings;
    for (const robot of this.robots) {
      const name = settings[robot.place], eps = settings[`${robot.place}_eps`];
      const [asked, present] = [name, robot.name].map((each) => JSON.stringify(controllers[each]?.parameters));
      if (name !== robot.name && asked === present) {
        robot.swap(name);
        this.settings[robot.place] = name;
        this.on.word({type: "swap", tick: this.tickOfWalk, version: controllers[name].is_learned ? "learned" : "zero"});
      }
      if (name === robot.name) {
        robot.eps = this.settings[`${robot.place}_eps`] = eps;
      }
      robot.change(settings);
    }
    for (const name of ["mass_scale", "payload", "ground_friction", "stone_width", "again"]) this.settings[name] = settings[name];
    this.sayTruth();
  }

  go(now) {
    if (!this.isMoving || now - this.due > BEHIND) this.due = now;
    while (this.isMoving && now >= this.due) {
      this.tick();
      this.due += (1000 * this.parts.numbers.plant.tick_seconds) / this.speed;
    }
    if (now - this.shown < STATE_EVERY || !this.hasChanged) return;
    Object.assign(this, {shown: now, hasChanged: false});
    const waiting = Object.keys(this.chosen).filter((name) => this.chosen[name] !== this.settings[name]);
    this.on.word({type: "state", settings: this.chosen, waiting, paused: this.isPaused, speed: this.speed});
  }

  tick() {
    if (this.afterEnd > AGAIN_TICKS) {
      if (this.chosen.again === "next course") this.chosen.seed = (this.chosen.seed % this.controls.find(({name}) => name === "seed").maximum) + 1;
      this.isResetDue = true;
    }
    if (this.isResetDue) this.reset();
    if (this.afterEnd) {
      this.afterEnd += 1;
      return;
    }
    const walking = this.robots.filter((robot) => !robot.outcome);
    for (const robot of walking) robot.tick();
    this.on.rows(Float32Array.from(this.robots.flatMap((robot) => robot.row)).buffer);
    this.tickOfWalk += 1;
    this.ticks += 1;
    if (walking.some((robot) => robot.outcome)) {
      this.on.word({type: "ended", walkers: this.robots.map((robot) => robot.ended)});
      this.afterEnd = Number(this.robots.every((robot) => robot.outcome));
    }
  }

  // what both believe, and what is true
  sayTruth() {
    const {mass_scale: scale, payload} = this.chosen, {links} = this.parts.numbers.plant;
    const mass = Object.values(links).reduce((sum, link) => sum + link.mass, 0), load = payload ? ` and carries ${payload} kg` : "";
    document.getElementById("truth").textContent =
      `Both controllers believe that the robot weighs ${mass.toFixed(0)} kg. It weighs ${(mass * scale).toFixed(0)} kg${load}.`;
  }

  async drop(event) {
    event.preventDefault();
    const [file] = event.dataTransfer.files;
    if (file) await this.load(file.name, await file.arrayBuffer());
  }

  // a policy file: from now on "learned" is that one
  async load(name, buffer) {
    try {
      const {compiled, numbers} = this.parts, isLearned = (name) => numbers.controllers[name].is_learned;
      takePolicy(buffer, numbers.policy, compiled[Object.keys(compiled).find(isLearned)]);
      for (const robot of this.robots) if (isLearned(robot.name)) robot.swap();
      this.on.word({type: "swap", tick: this.tickOfWalk, version: name});
    } catch (error) {
      this.refuse(error);
    }
  }

  refuse(error) {
    this.on.word({type: "refused", text: error.message});
  }
}
