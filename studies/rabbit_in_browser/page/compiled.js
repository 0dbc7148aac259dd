// An exported controller in WebAssembly: see controller.h of `rabbit export`.

const NUMBER = 8; // bytes

export class Compiled {
  static async load(bytes) {
    const {instance} = await WebAssembly.instantiate(bytes, {});
    instance.exports._initialize();
    return new Compiled(instance.exports);
  }

  constructor(exports) {
    this.exports = exports;
  }

  // room for so many numbers: where it is
  reserve(size) {
    return this.exports.malloc(Math.max(size, 1) * NUMBER);
  }

  release(...places) {
    places.forEach((at) => this.exports.free(at));
  }

  // a view, which is valid until the next `reserve`
  numbers(at, size, Kind = Float64Array) {
    return new Kind(this.exports.memory.buffer, at, size);
  }

  // a table of the policy
  table(name, values, Kind) {
    this.numbers(this.exports[name].value, values.length, Kind).set(values);
  }
}
