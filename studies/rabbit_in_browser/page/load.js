// What the robots are made of: MuJoCo, the compiled tick, the numbers and the shipped policy. `read(name)` gives a file's bytes.

import {Compiled} from "./compiled.js";
import {readPolicy} from "./policy.js";
import loadMujoco from "./mujoco.js";

export async function load(read) {
  const [numbers, tick, wasm, policy] = await Promise.all(["numbers.json.gz", "tick.wasm.gz", "mujoco.wasm.gz", "policy.safetensors.gz"].map(read));
  const about = JSON.parse(new TextDecoder().decode(numbers));
  const [mujoco, compiled] = await Promise.all([loadMujoco({wasmBinary: wasm}), Compiled.load(tick, about.functions)]);
  const policies = {zero: compiled.keep(new Float64Array(about.functions[Object.values(about.controllers)[0].tick].inputs.policy))};
  policies.learned = readPolicy(policy, about.policy, compiled);
  return {numbers: about, compiled, mujoco, policies};
}
