// A policy file, safetensors with metadata, into the tables of an exported controller. As weights.py.

const KEY = "rabbit_policy", MOST_BYTES = 8e6, PROBE_TOLERANCE = 1e-3;

// Checks the file, then has the controller `compiled` take its numbers; throws an Error that says what was found and what
// was expected. `about`: see numbers.py.
export function takePolicy(buffer, {problem, observations, tables, layers, widest, units, probe}, compiled) {
  if (buffer.byteLength > MOST_BYTES) throw new Error(`policy: ${buffer.byteLength} bytes; at most ${MOST_BYTES} are read`);
  const {head, tensors} = parsed(buffer);
  const known = observations.findIndex((names) => names.join() === (head.observation ?? []).join());
  const wrong = [
    [head.problem !== problem || head.quantities, `it was trained for ${head.problem}; the page runs ${problem}`],
    [head.residual || !head.structured, "it has another form; the page runs the paper's actor in the structured form"],
    [head.adaptation, `it adds to adaptation ${head.adaptation}; the page has none`],
    [known < 0, `it reads ${head.observation}; the page has ${observations.at(-1)}`],
  ].find(([is]) => is);
  if (wrong) throw new Error(`policy: ${wrong[1]}`);
  const reads = head.observation.length, sizes = [reads, ...layers.slice(1)], outputs = sizes[3];
  const scale = checked("observation_scale", head.observation_scale, reads);
  const weights = new Float32Array(tables.policy_weights), biases = [];
  let at = 0;
  for (let layer = 0; layer < 3; layer++) {
    const [inputs, units] = [sizes[layer], sizes[layer + 1]], own = checked(`${layer}.weight`, tensors[`${layer}.weight`], inputs * units);
    for (let i = 0; i < inputs; i++) for (let k = 0; k < units; k++) weights[at++] = own[k * inputs + i];
    biases.push(...checked(`${layer}.bias`, tensors[`${layer}.bias`], units));
  }
  const said = checked(probe, tensors[probe], 4 * outputs);
  const found = probeInputs(reads).flatMap((scaled) => outputsOf(compiled, sizes, widest, units, weights, biases, scaled));
  const off = Math.max(...found.map((value, i) => Math.abs(value - said[i])));
  if (!(off <= PROBE_TOLERANCE)) throw new Error(`policy: on the fixed observations its outputs differ by ${off} from those stored`);
  const named = {center: head.observation_center, inverse_scale: scale.map((each) => 1 / each), alpha_scale: head.alpha_scale, beta_scale: head.beta_scale};
  const all = Object.entries(named).map(([name, values]) => [name, checked(name, values, name.endsWith("a_scale") ? tables[`policy_${name}`] : reads)]);
  for (const [name, values] of all) compiled.table(`policy_${name}`, values);
  compiled.table("policy_weights", weights, Float32Array);
  compiled.table("policy_biases", biases);
  compiled.table("policy_sizes", sizes.map(BigInt), BigInt64Array);
}

// of a network that nobody uses yet, at scaled observations
function outputsOf(compiled, sizes, widest, units, weights, biases, scaled) {
  const parts = [[sizes.map(BigInt), BigInt64Array], [weights, Float32Array], [biases, Float64Array], [scaled, Float64Array], [[], Float64Array]];
  const at = parts.map(([values]) => compiled.reserve(values.length)), last = widest + units - sizes[3];
  at[4] = compiled.reserve(widest + units);
  parts.forEach(([values, Kind], i) => compiled.numbers(at[i], values.length, Kind).set(values));
  compiled.exports.policy_forward(1n, at[0], BigInt(widest), at[1], at[2], at[3], at[4]);
  const found = Array.from(compiled.numbers(at[4], widest + units).slice(last));
  compiled.release(...at);
  return found;
}

function parsed(buffer) {
  try {
    const size = Number(new DataView(buffer).getBigUint64(0, true)), start = 8 + size;
    const {__metadata__: words, ...about} = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 8, size)));
    const read = ({dtype, data_offsets: [from, to]}) => {
      if (dtype !== "F32") throw new Error(dtype);
      return new Float32Array(buffer.slice(start + from, start + to));
    };
    const tensors = Object.fromEntries(Object.entries(about).map(([name, each]) => [name, read(each)]));
    return {head: JSON.parse(words[KEY]).metadata, tensors};
  } catch {
    throw new Error("policy: not a policy file");
  }
}

function checked(name, values, size) {
  if (values?.length !== size || !Array.from(values).every(Number.isFinite)) throw new Error(`policy: ${name} has ${values?.length} numbers; expected ${size} finite ones`);
  return values;
}

// the fixed scaled observations: the centre, and three spread over [-1, 1]
function probeInputs(size) {
  return [0, 1, 2, 3].map((k) => Array.from({length: size}, (_, i) => (k ? Math.fround(Math.sin(k * (i + 1))) : 0)));
}
