// The true robot and its ground in MuJoCo's own WebAssembly module. As mujoco_plant.py and engine_plant.py.

import {TouchdownDetector} from "./ground.js";

export class Plant {
  // `settings`: mass_scale, payload (kg), ground_friction
  constructor(mujoco, numbers, settings) {
    Object.assign(this, {mujoco, numbers, settings});
    this.model = mujoco.MjModel.from_xml_string(robotMjcf(numbers, settings));
    this.data = new mujoco.MjData(this.model);
    const id = (kind, name) => mujoco.mj_name2id(this.model, mujoco.mjtObj[kind].value, name);
    this.torso = id("mjOBJ_BODY", "torso");
    this.firstStone = id("mjOBJ_GEOM", "stone_0");
    this.firstBody = id("mjOBJ_BODY", "stone_0");
    const {impedance, ground_stiffness: stiffness, ground_damping: damping, substep_seconds: seconds} = numbers;
    for (const name of ["left_foot", "right_foot"]) {
      const foot = id("mjOBJ_GEOM", name), inverseMass = this.model.body_invweight0[2 * this.model.geom_bodyid[foot]];
      const b = Math.min(damping * inverseMass, 1 / seconds);
      this.model.geom_solref.set([(-stiffness * inverseMass) / 2, -b / 2], 2 * foot);
      this.model.geom_solimp.set(impedance, impedance.length * foot);
    }
    this.watch = new TouchdownDetector(numbers, () => this.feet());
  }

  close() {
    this.data.delete();
    this.model.delete();
  }

  reset(q, dq, stance) {
    this.mujoco.mj_resetData(this.model, this.data);
    this.data.qpos.set(q);
    this.data.qvel.set(dq);
    this.setStones([]);
    this.pushes = [];
    this.force = [[0, 0], [0, 0]];
    this.contact = [stance === 0, stance === 1];
    this.watch = new TouchdownDetector(this.numbers, () => this.feet());
    this.footPosition = this.feet();
  }

  setStones(spans) {
    const {kept_stones: kept, stone_depth: depth, foot_radius: radius, away} = this.numbers;
    const {model, data} = this;
    for (let i = 0; i < kept; i++) {
      const [near, far] = spans[i] ?? [away, away];
      const half = [(far - near) / 2 + radius, 0.5, depth / 2], place = [(near + far) / 2, 0, -radius - depth / 2];
      const geom = this.firstStone + i;
      model.geom_size.set(half, 3 * geom);
      model.geom_aabb.set(half, 6 * geom + 3);
      model.geom_rbound[geom] = Math.hypot(...half);
      model.body_pos.set(place, 3 * (this.firstBody + i));
      data.mocap_pos.set(place, 3 * i);
    }
    this.watch.stones = spans;
  }

  push(force, seconds) {
    this.pushes = new Array(Math.round(seconds / this.numbers.substep_seconds)).fill(force);
  }

  // one tick under `command`, N m
  advance(command) {
    const {substeps, torque_limit: limit, contact_force: least} = this.numbers;
    const torque = command.map((each) => Math.min(Math.max(each, -limit), limit));
    const {mujoco, model, data} = this;
    data.qacc_warmstart.fill(0);
    this.watch.beginTick(this.footPosition);
    const sum = [[0, 0], [0, 0]];
    this.contact = [false, false];
    for (let i = 0; i < substeps; i++) {
      data.qfrc_applied.set(torque, 3);
      data.xfrc_applied[6 * this.torso] = this.pushes.shift() ?? 0;
      mujoco.mj_step(model, data);
      const [leftX, , leftZ, rightX, , rightZ] = data.sensordata;
      const forces = [[-leftX, -leftZ], [-rightX, -rightZ]];
      forces.forEach(([x, z], leg) => {
        sum[leg][0] += x;
        sum[leg][1] += z;
        this.contact[leg] ||= z > least;
      });
      this.watch.substep([forces[0][1], forces[1][1]]);
    }
    this.force = sum.map((each) => each.map((value) => value / substeps));
    this.footPosition = this.feet();
  }

  get q() {
    return Array.from(this.data.qpos.subarray(0, 7));
  }

  get dq() {
    return Array.from(this.data.qvel.subarray(0, 7));
  }

  feet() {
    return feet(this.data.qpos, this.numbers.link_length);
  }
}

// [x, z] of the left and the right foot
export function feet(q, length) {
  const link = (angle) => [-length * Math.sin(angle), -length * Math.cos(angle)];
  return [3, 5].map((hip) => {
    const upper = q[2] + q[hip], thigh = link(upper), shin = link(upper + q[hip + 1]);
    return [q[0] + thigh[0] + shin[0], q[1] + thigh[1] + shin[1]];
  });
}

// MuJoCo's XML of the robot with all masses scaled, then a point mass on the torso. As links.py and payload.py.
export function robotMjcf({mjcf, links, payload_height: height}, {mass_scale: scale, payload, ground_friction: friction}) {
  const words = {friction};
  for (const [name, link] of Object.entries(links)) {
    let mass = link.mass * scale, [x, y, z] = link.pos;
    const inertia = link.inertia.map((each) => each * scale);
    if (name === "torso") {
      const total = mass + payload, reduced = (mass * payload) / total, square = (height - z) ** 2;
      inertia[0] += reduced * square;
      inertia[1] += reduced * square;
      z = (mass * z + payload * height) / total;
      mass = total;
    }
    Object.assign(words, {[`${name}_mass`]: mass, [`${name}_pos`]: `${x} ${y} ${z}`, [`${name}_inertia`]: inertia.join(" ")});
  }
  return mjcf.replace(/@(\w+)/g, (_, name) => words[name]);
}
