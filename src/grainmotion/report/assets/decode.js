"use strict";
// Arrays and records of the page's data: base64 of zlib of little-endian bytes, shuffled (report/embedding.py).
(() => {
  const gm = (window.gm ??= {});

  const KINDS = {
    "<f4": Float32Array, "<i4": Int32Array, "<u4": Uint32Array, "<i2": Int16Array, "<u2": Uint16Array,
    "<i1": Int8Array, "<u1": Uint8Array,
  };

  const bytesOf = (text) => {
    if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
    const raw = atob(text), bytes = new Uint8Array(raw.length);
    for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
    return bytes;
  };

  const inflate = async (text) => {
    const stream = new Blob([bytesOf(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  };

  /** The typed array (with `.shape`) or the record behind an embedded one; decoded once. */
  const decoded = new WeakMap();
  gm.decode = (embedded) => {
    if (!decoded.has(embedded)) decoded.set(embedded, decode(embedded));
    return decoded.get(embedded);
  };

  const MISSING = -(2 ** 31), ZERO = MISSING + 1; // whole numbers of no value, and of 0 among logarithms

  /** Undo report/series_coding.py: values of all states, one state after another. */
  const series = (codes, columns, value) => {
    const numbers = new Int32Array(codes.length), values = new Float32Array(codes.length);
    for (let i = 0; i < codes.length; i++) {
      numbers[i] = ((codes[i] >>> 1) ^ -(codes[i] & 1)) + (i < columns ? 0 : numbers[i - columns]);
      values[i] = numbers[i] === MISSING ? NaN : value(numbers[i]);
    }
    return values;
  };

  const decode = async ({ dtype, shape, data, step, precision }) => {
    const bytes = await inflate(data);
    if (dtype === "json") return JSON.parse(new TextDecoder().decode(bytes));
    const Kind = KINDS[dtype], size = Kind.BYTES_PER_ELEMENT, count = bytes.length / size;
    const plain = size === 1 ? bytes : new Uint8Array(bytes.length);
    if (size > 1) {
      for (let k = 0; k < size; k++) for (let i = 0; i < count; i++) plain[i * size + k] = bytes[k * count + i];
    }
    const array = new Kind(plain.buffer, 0, count);
    if (step) return series(array, shape[1], (number) => number * step);
    if (precision) return series(array, shape[1], (number) => (number === ZERO ? 0 : Math.exp(number * precision)));
    array.shape = shape;
    return array;
  };
})();
