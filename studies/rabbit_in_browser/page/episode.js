// One robot on one course: what its controller sees, where its feet landed and how it ended. As simulation.py.

import {Plant} from "./plant.js";
import {Terrain} from "./ground.js";

export class Episode {
  // `course`: near edges of the stones, and the first state q, dq
  constructor(mujoco, numbers, settings, course) {
    Object.assign(this, {mujoco, numbers, settings});
    this.plant = new Plant(mujoco, numbers, settings);
    this.terrain = new Terrain(numbers, course.near, settings.stone_width);
    Object.assign(this, {outcome: "running", landings: [], tick: 0, touchdowns: 0, airborne: 0, fellIntoGap: false, applied: null});
    this.plant.reset(course.q, course.dq, 0);
    this.standOn(0, 0);
  }

  get state() {
    const {plant, tick, touchdowns, preview, applied} = this;
    return {tick, touchdowns, preview, applied, q: plant.q, dq: plant.dq, force: plant.force, contact: plant.contact};
  }

  step(torque) {
    this.plant.advance(torque);
    this.applied = torque;
    this.tick += 1;
    this.countLandings();
    if (this.outcome === "running") this.outcome = this.judge();
  }

  // another robot or ground, from the present state on
  change(settings) {
    const old = this.plant, present = [old.q, old.dq];
    this.plant = new Plant(this.mujoco, this.numbers, settings);
    this.plant.reset(...present, this.stance);
    this.plant.setStones(this.terrain.present);
    old.close();
    this.settings = settings;
  }

  standOn(leg, x) {
    Object.assign(this, {stance: leg, heldAt: x, landed: false, stepBegan: this.tick});
    this.preview = this.terrain.placeNext(this.touchdowns + 1, x, this.settings.stone_width);
    this.plant.setStones(this.terrain.present);
  }

  countLandings() {
    for (const touch of this.plant.watch.touches) {
      if (touch.leg === this.stance || this.outcome !== "running") continue;
      if (!this.landed) this.land(touch);
      if (touch.hold) {
        this.touchdowns += 1;
        this.standOn(touch.leg, touch.x);
      }
      if (this.touchdowns === this.terrain.nearEdges.length && this.outcome === "running") this.outcome = "walked";
    }
  }

  land(touch) {
    this.landed = true;
    const [near, far] = this.terrain.placed[this.touchdowns + 1];
    const l = touch.x - touch.otherX, l_min = near - touch.otherX, l_max = far - touch.otherX;
    this.landings.push({index: this.touchdowns + 1, tick: this.tick, l, l_min, l_max});
    this.fellIntoGap ||= !touch.hold;
    if (l < l_min || l > l_max || !touch.hold) this.outcome = touch.hold ? "miss" : "gap_fall";
  }

  judge() {
    const {plant, numbers} = this, {q, dq} = plant;
    if (![...q, ...dq].every(Number.isFinite)) return "diverged";
    if (q[1] < numbers.fall_height || Math.abs(q[2]) > numbers.fall_pitch) return this.fellIntoGap ? "gap_fall" : "fall";
    this.airborne = plant.contact.some((each) => each) ? 0 : this.airborne + 1;
    if (this.airborne >= numbers.flight_ticks && !this.fellIntoGap) return "flight";
    const x = plant.footPosition[this.stance][0];
    if (this.airborne) this.heldAt = x;  // a foot that hops does not slip
    if (this.settings.ground_friction <= numbers.slip_friction && Math.abs(x - this.heldAt) > numbers.slip_distance) return "slip";
    return this.tick - this.stepBegan >= numbers.stall_ticks ? "stall" : "running";
  }
}
