// One robot of a played walk: plant and controller, tick by tick, as rows for the page. As play/walker.py.

import {Controller} from "./controller.js";
import {Episode} from "./episode.js";
import {RowMaker} from "./rows.js";

const RUNNING = 1; // column of a row
const CLEAR = 0.01; // m, of a swing foot that is well in the air
const LIMP_TICKS = 150; // of a robot that no controller moves any more, at most

export class Robot {
  // `parts`: see load.js; `choice`: name of its controller; `settings`: of the page
  constructor(parts, choice, settings, eps) {
    const {mujoco, compiled, numbers} = parts, chosen = numbers.controllers[choice];
    const {near, starts} = numbers.courses[settings.seed - 1];
    Object.assign(this, {name: choice, parts});
    this.episode = new Episode(mujoco, numbers.plant, settings, {near, ...starts[chosen.gait]});
    this.controller = new Controller(compiled[choice], chosen);
    this.maker = new RowMaker(chosen.about, numbers.plant);
    this.about = {...chosen.about, eps, name: choice, stones: numbers.plant.stones, columns: chosen.columns};
    Object.assign(this, {pushedUntil: 0, isSwapped: false, next: null, limp: 0, outcome: "", fault: ""});
    this.eps = eps;
  }

  get ended() {
    return {outcome: this.outcome, stones: this.episode.touchdowns};
  }

  set eps(eps) {
    this.controller.eps = eps;
    this.maker.eps = eps;
  }

  push(force, seconds) {
    this.episode.plant.push(force, seconds);
    this.pushedUntil = this.episode.tick + Math.round(100 * seconds);
  }

  // mass, payload and friction once the swing foot is in the air, the stones' width from the next stone on
  change(settings) {
    this.next = settings;
  }

  // another policy acts from the next tick on; `name`: of the controller that has it, with the parameters of this one
  swap(name = this.name) {
    const old = this.controller, {compiled, numbers} = this.parts;
    this.isSwapped = true;
    if (name === this.name) return;
    this.controller = new Controller(compiled[name], numbers.controllers[name]);
    this.controller.follow(old);
    old.close();
    this.name = this.about.name = name;
  }

  tick() {
    if (this.outcome) return;
    const {episode} = this;
    if (this.next) this.changeNow();
    const state = episode.state;
    if (!this.fault) {
      this.output = this.controller.step(state);
      this.fault = this.output.fault;
    }
    if (this.fault) this.output = {...this.output, torque: [0, 0, 0, 0]};
    const events = [...(state.tick < this.pushedUntil ? ["pushed"] : []), ...(this.isSwapped ? ["swapped"] : [])];
    this.isSwapped = false;
    this.row = this.maker.row(state, this.output, events);
    this.row[RUNNING] = this.fault ? 0 : 1;
    episode.step(this.output.torque);
    this.limp += this.fault ? 1 : 0;
    if (episode.outcome === "running" && this.limp <= LIMP_TICKS) return;
    this.outcome = this.fault || episode.outcome;
    this.row[RUNNING] = 0;
  }

  changeNow() {
    const {plant, settings: old} = this.episode, {next} = this;
    const isPlant = ["mass_scale", "payload", "ground_friction"].some((name) => next[name] !== old[name]);
    const isInTheAir = !plant.contact.every((each) => each) && Math.max(...plant.footPosition.map(([, z]) => z)) >= CLEAR;
    if (isPlant && !isInTheAir) return;
    this.next = null;
    if (isPlant) this.episode.change(next);
    this.episode.settings = next;
  }

  close() {
    this.controller.close();
    this.episode.plant.close();
  }
}
