"use strict";
// The radiographs of a view as numbers (report/image_coding.py) and as coloured pictures.
(() => {
  const gm = (globalThis.gm ??= {});
  const MASKED = 255, ZERO = 127;
  const KINDS = {
    measured: { title: "measured", map: "grey" },
    simulated: { title: "simulated", map: "grey" },
    residual: { title: "residual", map: "vik" },
  };

  /** Undo differences of rows, in place: each row is less the one above it. */
  function addRows(array, columns, rows) {
    for (let start = 0; start < array.length; start += columns * rows) {
      for (let k = start + columns; k < start + columns * rows; k++) array[k] += array[k - columns];
    }
    return array;
  }

  /** Line integrals of all 256 bytes of a view's simulated and residual radiograph, NaN for masked ones. */
  function tables({ low, step, fine, knee }) {
    const bytes = Array.from({ length: 256 }, (_, k) => k);
    const residual = (k) => (knee === null ? fine * (k - ZERO) : knee * Math.sinh((fine * (k - ZERO)) / knee));
    return {
      simulated: Float32Array.from(bytes, (k) => (k === MASKED ? NaN : low + step * k)),
      residual: Float32Array.from(bytes, (k) => (k === MASKED ? NaN : residual(k))),
    };
  }

  async function read(view) {
    const [simulated, residual] = await Promise.all(["simulated", "residual"].map((k) => gm.decode(view.images[k])));
    const [height, width] = simulated.shape;
    const values = tables(view.coding), s = addRows(simulated.slice(), width, height);
    const images = { width, height };
    images.simulated = Float32Array.from(s, (k) => values.simulated[k]);
    images.residual = Float32Array.from(residual, (k) => values.residual[k]);
    images.measured = images.simulated.map((value, k) => value + images.residual[k]);
    images.masked = images.measured.some(Number.isNaN);
    return images;
  }

  /** A canvas of an image; `low` and `high` are the ends of the map; pixels without a value stay clear. */
  function paint(values, width, height, mapName, low, high) {
    const canvas = gm.el("canvas", { width, height });
    const pixels = new ImageData(width, height), table = gm.colours.table(mapName), scale = 255.999 / (high - low);
    for (let k = 0; k < values.length; k++) {
      const t = (values[k] - low) * scale;
      if (Number.isNaN(t)) continue;
      const place = 3 * Math.min(255, Math.max(0, t | 0));
      pixels.data[4 * k] = table[place];
      pixels.data[4 * k + 1] = table[place + 1];
      pixels.data[4 * k + 2] = table[place + 2];
      pixels.data[4 * k + 3] = 255;
    }
    canvas.getContext("2d").putImageData(pixels, 0, 0);
    return canvas;
  }

  /** The scales on which all radiographs of a report are first shown: { low, high, limit }. */
  function scales(data) {
    const views = data.states.flatMap((state) => state.views).filter((view) => view.images);
    if (!views.length) return { low: 0, high: 1, limit: 1 };
    const limits = views.map((view) => view.limit).sort((a, b) => a - b);
    return {
      low: Math.min(...views.map((view) => view.range[0])),
      high: Math.max(...views.map((view) => view.range[1])),
      limit: limits[limits.length >> 1],
    };
  }

  /** Fill a canvas with hatching, which stands for what has no value. */
  function hatch(context, width, height) {
    context.fillStyle = "#8a8f96";
    context.fillRect(0, 0, width, height);
    context.strokeStyle = "#6f757d";
    context.lineWidth = 2;
    context.beginPath();
    for (let x = -height; x < width; x += 8) {
      context.moveTo(x, height);
      context.lineTo(x + height, 0);
    }
    context.stroke();
  }

  const decoded = new WeakMap();
  gm.radiographImages = {
    KINDS, addRows, paint, hatch, scales,

    /** Promise of { width, height, measured, simulated, residual (Float32Arrays, NaN where masked), masked }, made once. */
    of(view) {
      if (!decoded.has(view)) decoded.set(view, read(view));
      return decoded.get(view);
    },

    /** Lowest and highest value of the map of a kind of image. */
    ends: (kind, { low, high, limit }) => (kind === "residual" ? [-limit, limit] : [low, high]),

    /** How much a view is averaged, in words. */
    averaging: ({ binning: k }) =>
      k > 1 ? `averaged over blocks of ${k} × ${k} pixels to keep this page small` : "every pixel of the panel",
  };
})();
