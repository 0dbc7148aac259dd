// A tick as the row of numbers that the page draws. As rows.py, whose columns these are.

const EVENTS = {saturated: 1, over_cone: 2, pushed: 4, swapped: 8};
const IMPACT_TICKS = 4, LOADED = 20, ROUNDING = 1e-6; // ticks, N, N m

export class RowMaker {
  // `eps`, of the gain, is set by who makes the robot
  constructor(about, numbers) {
    Object.assign(this, {about, numbers, step: -1, touchdowns: -1, start: [0, NaN], stone: [NaN, NaN], last: null});
  }

  // `events`: names of those that the player knows of
  row(state, output, events) {
    const {values, stance, index, torque} = output, points = bodyPoints(state.q, this.numbers), foot = points[stance ? 5 : 3];
    const V = values.V[0];
    if (index !== this.step) Object.assign(this, {step: index, start: [state.tick, V]});
    if (state.touchdowns !== this.touchdowns) {
      this.touchdowns = state.touchdowns;
      this.stone = state.preview ? [foot[0] + state.preview.l_min, foot[0] + state.preview.l_max] : [NaN, NaN];
    }
    const force = state.force[stance], ratio = force[1] > LOADED ? Math.abs(force[0]) / force[1] : NaN;
    const age = state.tick - this.start[0], bound = this.start[1] * Math.exp((-this.about.clf_rate / this.eps) * age * this.numbers.tick_seconds);
    if (Math.max(...torque.map(Math.abs)) > this.about.torque_limit - ROUNDING) events = [...events, "saturated"];
    if (ratio > this.about.friction_coeff && age >= IMPACT_TICKS) events = [...events, "over_cone"];
    const bits = events.reduce((sum, name) => sum | EVENTS[name], 0);
    return [
      state.tick, 1, bits, stance, index, state.touchdowns, ...points.flat(), ...this.stone, 0, ...force, ratio,
      V, bound, ...values.slack_sums, ...torque, ...values.barriers, ...this.errors(state.tick, values),
    ];
  }

  // of the nominal quantities over the tick before: estimated, then measured
  errors(tick, {nominal_a, nominal_b, alpha, beta, measured, mu}) {
    const affine = (a, b) => Array.from(b, (value, i) => mu.reduce((sum, each, k) => sum + a[i * mu.length + k] * each, value));
    const last = this.last;
    this.last = {tick, nominal: affine(nominal_a, nominal_b), estimated: affine(alpha, beta)};
    if (last?.tick !== tick - 1) return new Array(2 * beta.length).fill(NaN);
    return [...last.estimated, ...Array.from(measured, (value, i) => value - last.nominal[i])];
  }
}

// hip, head, left knee and foot, right knee and foot
function bodyPoints(q, {link_length: length, torso_length: torso}) {
  const [x, z, pitch] = q, down = ([fromX, fromZ], angle) => [fromX - length * Math.sin(angle), fromZ - length * Math.cos(angle)];
  const legs = [3, 5].flatMap((hip) => {
    const knee = down([x, z], pitch + q[hip]);
    return [knee, down(knee, pitch + q[hip] + q[hip + 1])];
  });
  return [[x, z], [x + torso * Math.sin(pitch), z + torso * Math.cos(pitch)], ...legs];
}
