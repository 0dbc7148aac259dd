// One controller: which leg stands, the step's path, the compiled tick. As controller.py.

import {Steps} from "./steps.js";

export class Controller {
  // `choice`: the numbers of a controller, see build.py; `policy`: where the compiled code finds one
  constructor(compiled, choice, gaits, policy) {
    const {functions} = compiled;
    Object.assign(this, {choice, policy, tick: functions[choice.tick], outputs: functions.outputs, feet: functions.feet});
    this.p = [...choice.p];
    this.steps = new Steps(gaits[choice.gait], choice.stone_aim, this.outputs);
    Object.assign(this, {stance: 0, index: 0, startTick: 0, isNew: true, held: [0, 0, 0, 0]});
    this.forget();
    this.follow(this.steps.first());
  }

  // the gain may change between two ticks; a difference of V under two gains measures nothing
  set eps(eps) {
    if (this.p[this.choice.places.eps[0]] !== eps) this.last = null;
    this.put({eps: [eps]});
  }

  // the torque, left before right, and all that was seen and decided; `fault`: why the walk must end
  step(state) {
    if (state.applied) {
      this.held = state.applied;
      this.torque = this.relabelled(state.applied);
    }
    const fault = this.swapLegs(state);
    if (this.isNew) this.beginStep(state);
    const x = [...this.coordinates(state.q), ...this.coordinates(state.dq)];
    const force = state.force[this.stance], {l_min, l_max} = state.preview;
    this.put({l_min: [l_min], l_max: [l_max], height: [0], force, held: this.relabelled(this.held)});
    const before = this.last?.tick === state.tick - 1 ? this.last.leaves : this.nothing;
    const values = this.tick({x, p: this.p, path: this.path.row, torque: this.torque, before, policy: this.policy});
    this.last = {tick: state.tick, leaves: values.leaves};
    const isSolved = values.residual[0] < this.choice.tolerance, limit = this.choice.about.torque_limit;
    const wanted = Array.from(isSolved ? values.u : values.control_b);
    this.torque = wanted.map((each) => Math.min(Math.max(each, -limit), limit));
    this.held = this.relabelled(this.torque);
    return {values, torque: this.held, stance: this.stance, index: this.index, fault: fault || (isSolved ? "" : "no solver answered")};
  }

  // hips and knees, left before right <-> stance before swing
  relabelled(joints) {
    return this.stance === 1 ? [...joints.slice(2), ...joints.slice(0, 2)] : joints;
  }

  coordinates(q) {
    return [...q.slice(0, 3), ...this.relabelled(q.slice(3))];
  }

  put(values) {
    for (const [name, value] of Object.entries(values)) value.forEach((each, i) => { this.p[this.choice.places[name][0] + i] = each; });
  }

  forget() {
    this.torque = [NaN, NaN, NaN, NaN];
    this.nothing ??= new Float64Array(this.choice.left).fill(NaN);
    this.last = null;
  }

  swapLegs({tick, q, dq, contact, touchdowns}) {
    const {swap_time: time, swap_phase: phase, tick_seconds: seconds} = this.choice;
    if (contact[1 - this.stance] && (tick - this.startTick) * seconds > time && this.phase(q, dq) > phase) {
      Object.assign(this, {stance: 1 - this.stance, index: this.index + 1, startTick: tick, isNew: true});
      this.forget();
    }
    return touchdowns === this.index ? "" : `contact disagreement: ${touchdowns} touchdowns, ${this.index} steps`;
  }

  phase(q, dq) {
    return this.outputs({q: this.coordinates(q), dq: this.coordinates(dq), scale: this.path.scale, path: this.path.row}).phase[0];
  }

  beginStep({q, dq, preview}) {
    const [now, rates] = [this.coordinates(q), this.coordinates(dq)];
    const {swing} = this.feet({q: now, joints: this.choice.joints, feet: this.choice.feet});
    this.follow(this.steps.begin(now, rates, -swing[0], preview));
    this.isNew = false;
  }

  follow(path) {
    this.path = path;
    this.put({phase_scale: path.scale, step_length: [this.steps.wanted]});
  }
}
