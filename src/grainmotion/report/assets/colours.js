// Colour maps that look even to the eye and that colour-blind readers can read.
//
// Each map is a list of anchors, evenly spaced, sRGB; colours between two anchors are interpolated, which differs from
// the original tables by less than 2 % (5 of 255).  batlow and vik: F. Crameri, Scientific colour maps 8 (MIT licence),
// https://doi.org/10.5281/zenodo.1243862; viridis and cividis: matplotlib (public domain, CC0).
"use strict";
(() => {
  const gm = (globalThis.gm ??= {});
  const ANCHORS = {
    batlow:
      "011959 08255b 0d315d 0f3b5f 114360 134b61 175262 1b5962 226061 2b655e 356a59 " +
      "416f53 4d734d 5a7745 677b3e 747e38 828231 91862d a18a2b b18d2f c09036 cf9340 " +
      "dd954d e9995c f29d6d f9a380 fca993 fdafa5 fdb4b6 fdbac7 fcc0d8 fbc6ea faccfa",
    viridis:
      "440154 470d60 48186a 482374 472d7b 453781 424086 3e4989 3b528b 375b8d 33638d " +
      "2f6b8e 2c728e 297a8e 26828e 23898e 21918c 1f988b 1fa088 22a785 28ae80 32b67a " +
      "3fbc73 4ec36b 5ec962 70cf57 84d44b 98d83e addc30 c2df23 d8e219 ece51b fde725",
    cividis:
      "00224e 00285b 002e6a 053371 1a386f 273e6e 32436d 3b496c 434e6c 4b546c 535a6d " +
      "5a5f6e 61656f 686a71 6f7073 767676 7d7c78 848279 8c8878 938e78 9b9476 a39a74 " +
      "aba072 b4a76f bcae6c c4b468 cdbb63 d5c25e dec958 e7d150 f0d846 f9e03a fee838",
    grey:
      "000000 ffffff",
    vik:
      "001261 021f69 022b71 023779 034481 055189 0c5e92 1c6d9c 307da6 488db2 619ebd " +
      "7aaec8 94bed2 adcddd c6dbe6 dee6e9 ece5e0 eed9cd e9cab8 e2baa2 dbaa8d d59b79 " +
      "cf8c66 c97e53 c27041 bc622f b2511d a33e0d 912d06 811f06 731406 650907 590008",
  };
  const DEFAULTS = { sequential: "viridis", diverging: "vik" };
  const TABLE_LENGTH = 256;
  const tables = new Map();

  function anchors(name) {
    if (!(name in ANCHORS)) throw new Error(`no colour map '${name}'; there are ${Object.keys(ANCHORS).join(", ")}`);
    return ANCHORS[name].split(" ").map(rgb);
  }

  /** Red, green and blue, 0 to 255, of "#rrggbb" or "rrggbb". */
  function rgb(text) {
    const value = parseInt(text.replace("#", ""), 16);
    return [(value >> 16) & 255, (value >> 8) & 255, value & 255];
  }

  /** The map as a function: a number from 0 to 1 (clipped) to [red, green, blue], 0 to 255. */
  function map(name) {
    const colours = anchors(name);
    const last = colours.length - 1;
    return (t) => {
      const place = Math.min(Math.max(t, 0), 1) * last;
      const k = Math.min(Math.floor(place), last - 1);
      return [0, 1, 2].map((c) => Math.round(colours[k][c] + (place - k) * (colours[k + 1][c] - colours[k][c])));
    };
  }

  /** The map as 256 colours, one after another, 3 bytes each: for images and textures. */
  function table(name) {
    if (!tables.has(name)) {
      const colour = map(name);
      const bytes = new Uint8Array(3 * TABLE_LENGTH);
      for (let i = 0; i < TABLE_LENGTH; i++) bytes.set(colour(i / (TABLE_LENGTH - 1)), 3 * i);
      tables.set(name, bytes);
    }
    return tables.get(name);
  }

  const css = (colour) => `rgb(${colour.join(" ")})`;

  /** A CSS background that shows the map from low to high. */
  const gradient = (name, direction = "to right") =>
    `linear-gradient(${direction}, ${anchors(name).map(css).join(", ")})`;

  /** Black or white, whichever is easier to read on a colour. */
  const ink = ([r, g, b]) => (0.299 * r + 0.587 * g + 0.114 * b > 140 ? "#000" : "#fff");

  gm.colours = { names: Object.keys(ANCHORS), DEFAULTS, map, table, css, gradient, rgb, ink };
})();
