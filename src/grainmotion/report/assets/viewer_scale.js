"use strict";
// The range of a quantity and the colours of its values.
(() => {
  const gm = (window.gm ??= {});
  const CLIPPED = 0.02; // share of the values beyond either end of the automatic range
  const NO_VALUE = { light: [168, 174, 182], dark: [96, 104, 114] };

  const percentile = (sorted, share) => {
    const place = share * (sorted.length - 1), k = Math.floor(place);
    return sorted[k] + (place - k) * ((sorted[k + 1] ?? sorted[k]) - sorted[k]);
  };

  /** A number with two significant digits, next below or above. */
  const rounded = (value, up) => {
    if (!value) return 0;
    const step = 10 ** (Math.floor(Math.log10(Math.abs(value))) - 1);
    return Number(((up ? Math.ceil : Math.floor)(value / step - (up ? 1e-9 : -1e-9)) * step).toPrecision(12));
  };

  /** Range [low, high] that holds nearly all values of every column; symmetric about 0 for diverging quantities. */
  const robustRange = (columns, kind) => {
    let low = Infinity, high = -Infinity;
    for (const column of columns) {
      const sorted = column.filter(Number.isFinite).sort();
      if (!sorted.length) continue;
      low = Math.min(low, percentile(sorted, CLIPPED));
      high = Math.max(high, percentile(sorted, 1 - CLIPPED));
    }
    if (!(low <= high)) return [0, 1];
    if (kind === "diverging") {
      const top = rounded(Math.max(-low, high), true) || 1;
      return [-top, top];
    }
    if (low > 0 && low < 0.3 * high) low = 0;
    low = rounded(low, false);
    high = rounded(high, true);
    return high > low ? [low, high] : [low, low + (Math.abs(low) || 1)];
  };

  /** Colours (3 a grain, 0 to 255) of values on a map from low to high. */
  const colours = (values, map, [low, high], theme) => {
    const out = new Uint8ClampedArray(3 * values.length);
    values.forEach((value, i) => {
      out.set(Number.isFinite(value) ? map((value - low) / (high - low)) : NO_VALUE[theme], 3 * i);
    });
    return out;
  };

  /** Colours of statuses by their number; 255 for none. */
  const statusColours = (numbers, statuses, theme) => {
    const palette = statuses.map((status) => gm.colours.rgb(status.colour));
    const out = new Uint8ClampedArray(3 * numbers.length);
    numbers.forEach((number, i) => out.set(palette[number] ?? NO_VALUE[theme], 3 * i));
    return out;
  };

  gm.viewerScale = { robustRange, colours, statusColours };
})();
