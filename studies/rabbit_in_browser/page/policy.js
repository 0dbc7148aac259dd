// A policy file, safetensors with metadata, as the numbers that the compiled actor reads. As weights.py.

const KEY = "rabbit_policy", MOST_BYTES = 8e6, PROBE_TOLERANCE = 1e-3;

// Checks and reads; throws an Error that says what was found and what was expected. `about`: see build.py.
export function readPolicy(buffer, {shapes, problem, observations, probe}, compiled) {
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
  const reads = head.observation.length, all = observations.at(-1).length;
  const {observation_center: center, observation_scale: scale, alpha_scale, beta_scale} = head;
  const own = {...tensors, center, inverse_scale: scale?.map((each) => 1 / each), alpha_scale, beta_scale};
  const sizes = {"0.weight": [shapes["0.weight"][0], reads], center: [reads, 1], inverse_scale: [reads, 1]};
  const parts = Object.entries(shapes).map(([name, shape]) => {
    const [rows, columns] = sizes[name] ?? shape;
    return byColumns(checked(name, own[name], rows * columns), [rows, columns], shape);
  });
  const numbers = Float64Array.from(parts.flatMap((part) => Array.from(part)));
  const policy = compiled.keep(numbers), said = checked(probe.name, tensors[probe.name], 4 * probe.outputs);
  const off = Math.max(...probeInputs(reads).flatMap((scaled, k) => {
    const {outputs} = compiled.functions.actor({scaled: padded(scaled, all), policy});
    return Array.from(outputs, (value, i) => Math.abs(value - said[k * probe.outputs + i]));
  }));
  if (!(off <= PROBE_TOLERANCE)) {
    compiled.release(policy);
    throw new Error(`policy: on the fixed observations its outputs differ by ${off} from those stored`);
  }
  return policy;
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

function padded(values, size) {
  return [...values, ...new Array(size - values.length).fill(0)];
}

// a matrix that lies row by row, column by column, with zeros in the rows and columns that it lacks
function byColumns(values, [rows, columns], [allRows, allColumns]) {
  const found = new Float64Array(allRows * allColumns);
  for (let row = 0; row < rows; row++) for (let column = 0; column < columns; column++) found[column * allRows + row] = values[row * columns + column];
  return found;
}

// the fixed scaled observations: the centre, and three spread over [-1, 1]
function probeInputs(size) {
  return [0, 1, 2, 3].map((k) => Array.from({length: size}, (_, i) => (k ? Math.fround(Math.sin(k * (i + 1))) : 0)));
}
