// Functions that CasADi wrote as C, in WebAssembly: arrays in, named arrays out.

const NUMBER = 8, POINTER = 4; // bytes

export class Compiled {
  // `about`: of each function its inputs' sizes, and the places of its outputs in one row; see build.py
  static async load(bytes, about) {
    const {instance} = await WebAssembly.instantiate(bytes, {});
    return new Compiled(instance.exports, about);
  }

  constructor(exports, about) {
    this.exports = exports;
    exports._initialize();
    this.functions = Object.fromEntries(Object.entries(about).map(([name, each]) => [name, this.made(name, each)]));
  }

  reserve(bytes) {
    return this.exports.malloc(Math.max(bytes, NUMBER));
  }

  numbers(at, size) {
    return new Float64Array(this.exports.memory.buffer, at, size);
  }

  // numbers that are an input of many calls, such as a policy's: the place to pass in their stead
  keep(values) {
    const at = this.reserve(values.length * NUMBER);
    this.numbers(at, values.length).set(values);
    return {keptAt: at};
  }

  release({keptAt}) {
    this.exports.free(keptAt);
  }

  made(name, {inputs, places, size}) {
    const {exports} = this, needed = this.reserve(4 * POINTER);
    exports[`${name}_work`](needed, needed + POINTER, needed + 2 * POINTER, needed + 3 * POINTER);
    const [args, results, integers, reals] = new Int32Array(exports.memory.buffer, needed, 4);
    const arg = this.reserve(args * POINTER), res = this.reserve(results * POINTER);
    const iw = this.reserve(integers * POINTER), w = this.reserve(reals * NUMBER), row = this.reserve(size * NUMBER);
    const memory = exports[`${name}_checkout`]();
    const given = Object.entries(inputs).map(([key, length]) => ({key, length, at: this.reserve(length * NUMBER)}));
    return (values) => {
      const argument = new Int32Array(exports.memory.buffer, arg, args);
      given.forEach(({key, length, at}, i) => {
        const value = values[key];
        argument[i] = value.keptAt ?? at;
        if (value.keptAt !== undefined) return;
        if (value.length !== length) throw new Error(`${name}: ${key} has ${value.length} numbers, expected ${length}`);
        this.numbers(at, length).set(value);
      });
      new Int32Array(exports.memory.buffer, res, results)[0] = row;
      if (exports[name](arg, res, iw, w, memory) !== 0) throw new Error(`${name}: the compiled function failed`);
      const found = this.numbers(row, size).slice();
      return Object.fromEntries(Object.entries(places).map(([key, [from, to]]) => [key, found.subarray(from, to)]));
    };
  }
}
