// The stones of an episode, all at one height, and when and where a foot comes down. As terrain.py and touchdown_detector.py.

export class Terrain {
  constructor(numbers, nearEdges, width) {
    this.numbers = numbers;
    this.nearEdges = nearEdges;
    this.placed = [[numbers.platform_start, width / 2]];
  }

  // of those placed, what is in reach
  get present() {
    return this.placed.slice(-this.numbers.kept_stones);
  }

  // stone `index`, from 1, of this width, for a stance foot at x = `foot`: what is previewed of it; null after the last
  placeNext(index, foot, width) {
    if (index > this.nearEdges.length) return null;
    const near = this.nearEdges[index - 1], far = Math.min(near + width, this.numbers.farthest_edge);
    this.placed.push([foot + near, foot + far]);
    return {index, l_min: foot + near - foot, l_max: foot + far - foot};
  }
}

export class TouchdownDetector {
  // `locate`: where both feet are, [x, z] of left and right
  constructor(numbers, locate) {
    Object.assign(this, {numbers, locate, stones: [], clear: [false, false], crossings: [null, null], touches: []});
  }

  isUnder(x) {
    const {foot_radius: edge} = this.numbers;
    return this.stones.some(([near, far]) => near - edge <= x && x <= far + edge);
  }

  beginTick(feet) {
    this.touches = [];
    feet.forEach(([, z], leg) => { this.clear[leg] ||= z > this.numbers.clear_height; });
    this.see(feet);
  }

  // normal forces on left and right in the substep that has just ended, N
  substep(forces) {
    const {contact_force: least, edge_depth: depth} = this.numbers;
    forces.forEach((force, leg) => {
      if (!(force > least)) return;
      if (this.clear[leg]) {
        const feet = this.locate();
        this.touch({leg, x: feet[leg][0], otherX: feet[1 - leg][0], hold: feet[leg][1] > -depth});
      }
      this.clear[leg] = false;
    });
    this.unseen -= 1;
    if (this.unseen <= 0) this.watchHeights();
  }

  // over a gap a foot is below the tops, and was clear: where it went through
  watchHeights() {
    const feet = this.locate();
    feet.forEach(([x, z], leg) => {
      if (this.crossings[leg] && this.clear[leg]) this.touch(this.crossings[leg]);
      if (!this.clear[leg] || this.isUnder(x) || !(z < 0)) return;
      const above = this.last[leg][1], share = above > 0 ? above / (above - z) : 0;
      const along = this.last.map(([from], i) => from + share * (feet[i][0] - from));
      this.crossings[leg] = {leg, x: along[leg], otherX: along[1 - leg], hold: false};
    });
    this.see(feet);
  }

  see(feet) {
    this.last = feet;
    const height = Math.min(...feet.map(([, z], leg) => (this.clear[leg] ? z : Infinity)));
    this.unseen = height < Infinity ? Math.max(Math.ceil(height / this.numbers.fastest_fall) - 1, 1) : Infinity;
  }

  touch(touch) {
    this.touches.push(touch);
    this.clear[touch.leg] = false;
    this.crossings[touch.leg] = null;
  }
}
