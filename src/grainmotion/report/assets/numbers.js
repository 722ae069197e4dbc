"use strict";
// Statistics of columns; NaN stands for what is not known.
(() => {
  const gm = (window.gm ??= {});

  gm.median = (values) => {
    const known = values.filter(Number.isFinite).sort();
    if (!known.length) return NaN;
    const half = known.length >> 1;
    return known.length % 2 ? known[half] : (known[half - 1] + known[half]) / 2;
  };

  gm.count = (values, wanted) => values.reduce((sum, value) => sum + (value === wanted), 0);

  /** "12, 14-20 31" as a test of labels; null if the text is none of that kind. */
  gm.labelTest = (text) => {
    const parts = text.trim().split(/[\s,;]+/).filter(Boolean);
    const ranges = parts.map((part) => /^(\d+)(?:[-–](\d+))?$/.exec(part));
    if (!parts.length || ranges.includes(null)) return null;
    const bounds = ranges.map(([, low, high]) => [Number(low), Number(high ?? low)]);
    return (label) => bounds.some(([low, high]) => label >= low && label <= high);
  };
})();
