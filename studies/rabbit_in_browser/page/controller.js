// One exported controller with its memory, for one robot.

const NEVER = -2; // a tick that none follows
const FAULTS = {2: "no solver answered", 3: "torque not finite"};

export class Controller {
  // `choice`: the layouts of a controller, see numbers.py
  constructor(compiled, choice) {
    Object.assign(this, {compiled, choice});
    const {memory, reading, settings, report} = choice;
    this.at = [memory.size, reading.size, settings.size, report.size].map((size) => compiled.reserve(size));
    compiled.exports.controller_first(this.at[0]);
    compiled.exports.controller_settings(this.at[2]);
    this.compiled.numbers(this.at[1], reading.size).fill(0);
  }

  close() {
    this.compiled.release(...this.at);
  }

  get memory() {
    return this.compiled.numbers(this.at[0], this.choice.memory.size);
  }

  get settings() {
    return this.compiled.numbers(this.at[2], this.choice.settings.size);
  }

  // go on where another controller of the same layout is
  follow(other) {
    this.memory.set(other.memory);
    this.settings.set(other.settings);
  }

  // the gain may change between two ticks; a difference of V under two gains measures nothing
  set eps(eps) {
    if (eps === this.eps) return;
    this.settings[this.choice.settings.places.eps[0]] = eps;
    this.memory[this.choice.memory.places.last_tick[0]] = NEVER;
  }

  get eps() {
    return this.settings[this.choice.settings.places.eps[0]];
  }

  // the torque, left before right, and all that was seen and decided; `fault`: why the walk must end
  step(state) {
    const {tick, touchdowns, q, dq, force, contact, applied, preview} = state, {places, size} = this.choice.reading;
    const given = {
      tick: [tick], touchdowns: [touchdowns], q, dq, foot_force: force.flat(), contact: contact.map(Number),
      applied: applied ?? [NaN, NaN, NaN, NaN], stone: [preview.index, preview.l_min, preview.l_max, 0],
    };
    const reading = this.compiled.numbers(this.at[1], size);
    for (const [name, values] of Object.entries(given)) reading.set(values, places[name][0]);
    this.compiled.exports.controller_step(...this.at);
    const row = this.compiled.numbers(this.at[3], this.choice.report.size).slice();
    const part = (name) => row.subarray(...this.choice.report.places[name]), number = (name) => part(name)[0];
    const {about: {quantities}, report: {places: told}} = this.choice;
    const none = {alpha: new Float64Array(4 * quantities.length), beta: new Float64Array(quantities.length)};
    const values = Object.fromEntries(["V", "barriers", "measured", "nominal_a", "nominal_b", "mu", "slack_sums", "residual"].map((name) => [name, part(name)]));
    for (const name of ["alpha", "beta"]) values[name] = name in told ? part(name) : none[name];
    const [stance, index] = [number("stance"), number("index")];
    const disagreement = number("fault") === 1 ? `contact disagreement: ${touchdowns} touchdowns, ${index} steps` : FAULTS[number("fault")] ?? "";
    return {values, torque: Array.from(part("command")), stance, index, fault: number("refused") ? "the state is refused" : disagreement};
  }
}
