// One episode as it is known here: rows of numbers, and what they say of stones and faults. See rows.py for the columns.

const EVENTS = {saturated: 1, over_cone: 2, pushed: 4, swapped: 8};
const LOW = 0.7; // m, of a hip above the lower foot: the robot falls
const PLATFORM = -1; // m, where the first platform begins

export class Walk {
  constructor(about) {
    this.about = about;
    this.width = about.walkers.reduce((sum, walker) => sum + walker.columns.length, 0);
    this.data = new Float32Array(this.width * 1024);
    this.length = 0;
    let offset = 0;
    this.walkers = about.walkers.map((walker) => {
      const one = new Walker(this, walker, offset);
      offset += walker.columns.length;
      return one;
    });
  }

  add(buffer) {
    const rows = new Float32Array(buffer);
    const size = this.length * this.width + rows.length;
    if (size > this.data.length) {
      const larger = new Float32Array(Math.max(size, 2 * this.data.length));
      larger.set(this.data.subarray(0, this.length * this.width));
      this.data = larger;
    }
    this.data.set(rows, this.length * this.width);
    const from = this.length;
    this.length += rows.length / this.width;
    for (const walker of this.walkers) walker.note(from, this.length);
  }

  // {from, to} of each robot that fell or is falling, rows, the first one first
  get falls() {
    return this.walkers.map(({fall}) => fall).filter(Boolean).sort((one, other) => one.from - other.from);
  }

  // seconds since the reset
  time(row) {
    return Math.max(...this.walkers.map((walker) => walker.get(row, "tick"))) * this.about.tick_seconds;
  }
}

class Walker {
  constructor(walk, about, offset) {
    this.walk = walk;
    this.about = about;
    this.column = Object.fromEntries(about.columns.map((name, i) => [name, offset + i]));
    this.stones = []; // {row, near, far, top}; seen from `row` on
    this.marks = []; // {row, kind}
    this.touchdowns = -1;
    this.was = 0;
    this.fall = null; // {from, to}
  }

  get(row, name) {
    return this.walk.data[row * this.walk.width + this.column[name]];
  }

  has(name) {
    return name in this.column;
  }

  rowOf(tick) {
    for (let row = 0; row < this.walk.length; row++) if (this.get(row, "tick") === tick) return row;
    return this.walk.length - 1;
  }

  point(row, name) {
    return [this.get(row, name + "_x"), this.get(row, name + "_z")];
  }

  // find stones and faults in new rows
  note(from, to) {
    for (let row = from; row < to; row++) {
      const touchdowns = this.get(row, "touchdowns");
      if (touchdowns !== this.touchdowns) {
        const [near, far] = [this.get(row, "stone_near"), this.get(row, "stone_far")];
        if (Number.isFinite(near)) {
          if (!this.stones.length) this.stones.push({row: 0, near: Math.min(PLATFORM, near - 1.3), far: touchdowns ? near - 0.3 : (far - near) / 2, top: 0});
          this.stones.push({row, near, far, top: this.get(row, "stone_top")});
        }
        if (this.touchdowns >= 0) this.marks.push({row, kind: "stone", number: touchdowns});
        this.touchdowns = touchdowns;
      }
      this.watch(row);
      const events = this.get(row, "events");
      const begun = events & ~this.was;
      for (const [kind, bit] of Object.entries(EVENTS)) if (begun & bit) this.marks.push({row, kind});
      this.was = events;
    }
  }

  // whether it falls; a robot whose ticks no longer count lies where it fell
  watch(row) {
    if (!this.has("hip_z") || row && this.get(row, "tick") === this.get(row - 1, "tick")) return;
    const height = this.get(row, "hip_z") - Math.min(this.get(row, "left_foot_z"), this.get(row, "right_foot_z"));
    if (height > LOW) this.fall = null;
    else this.fall = {from: this.fall?.from ?? row, to: row};
  }
}
