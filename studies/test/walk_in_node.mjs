// The page's code without a browser: `node walk_in_node.mjs FOLDER`, a question as JSON on stdin, the answer on stdout.

import {readFile} from "node:fs/promises";
import {gunzipSync} from "node:zlib";
import {pathToFileURL} from "node:url";

const folder = process.argv[2], module = (name) => import(pathToFileURL(`${folder}/${name}.js`));
const [{load}, {Controller}, {Robot}, {robotMjcf}, {takePolicy}, {RowMaker}] = await Promise.all(["load", "controller", "robot", "plant", "policy", "rows"].map(module));

async function read(name) {
  const {buffer, byteOffset, byteLength} = gunzipSync(await readFile(`${folder}/${name}`));
  return buffer.slice(byteOffset, byteOffset + byteLength);
}

const QUESTIONS = {
  // torques at recorded states, how exact the answers of the QP are, and what is drawn
  torques({name, states}) {
    const {compiled, numbers} = parts, choice = numbers.controllers[name];
    const controller = new Controller(compiled[name], choice);
    const maker = Object.assign(new RowMaker(choice.about, numbers.plant), {eps: choice.about.eps});
    return states.map((state) => {
      const output = controller.step(state);
      return {torque: output.torque, residual: output.values.residual[0], row: maker.row(state, output, [])};
    });
  },
  // how walks end
  walks({name, settings, seeds}) {
    const {eps} = parts.numbers.controllers[name].about;
    return seeds.map((seed) => {
      const robot = new Robot(parts, name, {...settings, seed}, eps);
      while (!robot.outcome) robot.tick();
      const found = {...robot.ended, ticks: robot.episode.tick, landings: robot.episode.landings};
      robot.close();
      return found;
    });
  },
  mjcf: ({settings}) => robotMjcf(parts.numbers.plant, settings),
  // what is said of files that may be no policies, as base64
  policies: ({files}) => files.map((file) => {
    try {
      takePolicy(Uint8Array.from(Buffer.from(file, "base64")).buffer, parts.numbers.policy, parts.compiled.learned);
      return "read";
    } catch (error) {
      return error.message;
    }
  }),
};

const parts = await load(read);
let text = "";
for await (const chunk of process.stdin) text += chunk;
const {ask, ...question} = JSON.parse(text);
process.stdout.write(JSON.stringify(QUESTIONS[ask](question)));
