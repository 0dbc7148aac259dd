// The desired path of each step: the gait's own, or found in a library. As step_begin.py and step_paths.py.

const FADED = 0.5, LEAST_WIDTH = 0.1, LEAST_RATE = 0.5; // of the correction, see step_begin.py

export class Steps {
  // `gait`: lengths, and of each length Bezier coefficients (4 x 6) and the phase angles at both ends
  constructor(gait, aim, outputs) {
    Object.assign(this, {gait, aim, outputs, hasLengths: gait.lengths.length > 1});
  }

  first() {
    this.wanted = this.hasLengths ? this.gait.start_length : 0;
    return pathOf(this.hasLengths ? this.between(this.wanted, this.wanted) : this.gait.paths[0]);
  }

  // of the step that begins at a state in stance/swing order; `taken`: how far apart the feet stand, m
  begin(q, dq, taken, stone) {
    if (!this.hasLengths) return pathOf(this.gait.paths[0]);
    const {lengths} = this.gait, wanted = stone.l_min + this.aim * (stone.l_max - stone.l_min);
    this.wanted = Math.min(Math.max(wanted, lengths[0]), lengths.at(-1));
    return this.corrected(this.between(taken, this.wanted), q, dq);
  }

  // begins as a step of length `taken`, ends as one of `wanted`
  between(taken, wanted) {
    const first = this.along(taken), last = this.along(wanted), half = first.coeffs[0].length / 2;
    return {coeffs: first.coeffs.map((row, i) => [...row.slice(0, half), ...last.coeffs[i].slice(half)]), start: first.start, end: last.end};
  }

  along(length) {
    const {lengths, paths} = this.gait, last = lengths.length - 1;
    const inside = Math.min(Math.max(length, lengths[0]), lengths[last]);
    const found = lengths.findIndex((each) => each > inside), at = found < 0 ? last : found;
    const share = (inside - lengths[at - 1]) / (lengths[at] - lengths[at - 1]), one = paths[at - 1], other = paths[at];
    const mean = (a, b) => (1 - share) * a + share * b;
    return {
      coeffs: one.coeffs.map((row, i) => row.map((value, k) => mean(value, other.coeffs[i][k]))),
      start: mean(one.start, other.start), end: mean(one.end, other.end),
    };
  }

  // made zero, with its rates, at the state that the step begins with
  corrected(path, q, dq) {
    const plain = pathOf(path), {eta, phase: [phase], phase_rate: [rate]} = this.outputs({q, dq, scale: plain.scale, path: plain.row});
    const width = Math.max(FADED - phase, LEAST_WIDTH);
    const coeffs = path.coeffs.map((_, i) => {
      const a = eta[i], b = (width * eta[4 + i]) / Math.max(rate, LEAST_RATE) + 3 * a;
      return [a, (a + b) / 4, 0, 0, 0];
    });
    return pathOf(path, coeffs, [phase, width]);
  }
}

// `scale`: from phase angle to phase; `row`: the numbers of a path as `path_row` in virtual_constraints.py has them
function pathOf({coeffs, start, end}, correction = coeffs.map(() => [0, 0, 0, 0, 0]), span = [0, 1]) {
  const scale = [1 / (end - start), start / (end - start)];
  const powers = coeffs.map((row) => [...toPowers(row), 0, 0]);
  return {scale, row: [...powers.flat(), ...correction.map(toPowers).flat(), ...span, 0, 0, 0, 0]};
}

// coefficients of 1, s, s^2, ... of a Bezier polynomial
function toPowers(points) {
  const degree = points.length - 1, found = points.map(() => 0);
  for (let k = 0; k <= degree; k++) {
    for (let j = 0; j <= degree - k; j++) found[k + j] += points[k] * choose(degree, k) * choose(degree - k, j) * (-1) ** j;
  }
  return found;
}

function choose(n, k) {
  return k === 0 ? 1 : (choose(n - 1, k - 1) * n) / k;
}
