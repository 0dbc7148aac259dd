// What the robots are made of: MuJoCo, the compiled controllers and the numbers. `read(name)` gives a file's bytes.

import {Compiled} from "./compiled.js";
import loadMujoco from "./mujoco.js";

export async function load(read) {
  const numbers = JSON.parse(new TextDecoder().decode(await read("numbers.json.gz")));
  const names = Object.keys(numbers.controllers);
  const [wasm, ...modules] = await Promise.all(["mujoco.wasm", ...names.map((name) => numbers.controllers[name].module)].map((name) => read(`${name}.gz`)));
  const [mujoco, ...compiled] = await Promise.all([loadMujoco({wasmBinary: wasm}), ...modules.map((bytes) => Compiled.load(bytes))]);
  return {numbers, mujoco, compiled: Object.fromEntries(names.map((name, i) => [name, compiled[i]]))};
}
