"use strict";
// Small line charts, drawn anew where their width changes, so that texts keep their size.
(() => {
  const gm = (window.gm ??= {});
  const { svg } = gm;
  const COLOURS = 5; // --series-1 to --series-5 in theme.css
  const DASHES = ["", "6 3", "2 3"]; // series differ without colour too
  const MARGIN = { left: 58, right: 14, top: 12, bottom: 34 };

  const linearTicks = (low, high, count) => {
    const raw = (high - low) / count, power = 10 ** Math.floor(Math.log10(raw));
    const step = power * [1, 2, 5, 10].find((m) => m * power >= raw * 0.999);
    const ticks = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++) ticks.push(k * step);
    return ticks;
  };

  const logTicks = (low, high) => {
    const ticks = [], wide = high / low > 300;
    for (let p = Math.floor(Math.log10(low)); p <= Math.log10(high); p++) {
      for (const m of wide ? [1] : [1, 2, 5]) {
        const tick = m * 10 ** p;
        if (tick >= low * 0.999 && tick <= high * 1.001) ticks.push(tick);
      }
    }
    return ticks;
  };

  const plain = (value) => {
    if (value === 0) return "0";
    const size = Math.abs(value);
    return (size < 1e-3 || size >= 1e5 ? value.toExponential(0) : String(Number(value.toPrecision(6)))).replaceAll("-", "−");
  };

  const range = (spec) => {
    const values = spec.series.flatMap(({ values: v, sd }) => v.flatMap((x, i) => (sd && Number.isFinite(sd[i]) ? [x - sd[i], x + sd[i]] : [x])));
    const known = values.filter((value) => Number.isFinite(value) && (!spec.log || value > 0));
    let low = Math.min(...known), high = Math.max(...known);
    if (!known.length) return spec.log ? [0.1, 1] : [0, 1];
    if (spec.log) return high < 1.5 * low ? [low / 1.3, high * 1.3] : [low / 1.08, high * 1.08];
    if (spec.fromZero) { low = Math.min(0, low); high = Math.max(0, high); }
    const pad = high > low ? 0.06 * (high - low) : Math.abs(high) || 1;
    return [low - (spec.fromZero && low === 0 ? 0 : pad), high + pad];
  };

  /** Path through the points, broken where a value is missing. */
  const path = (points) => {
    let open = false, text = "";
    for (const [x, y] of points) {
      if (Number.isFinite(y)) text += `${open ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`;
      open = Number.isFinite(y);
    }
    return text;
  };

  const draw = (spec, width) => {
    const height = spec.height ?? 190, count = spec.x.length;
    const inner = width - MARGIN.left - MARGIN.right, tall = height - MARGIN.top - MARGIN.bottom;
    const [low, high] = range(spec), [x0, x1] = [spec.x[0], spec.x[count - 1]];
    const x = (value) => MARGIN.left + (x1 > x0 ? ((value - x0) / (x1 - x0)) * inner : inner / 2);
    const unit = spec.log ? (v) => Math.log(v / low) / Math.log(high / low) : (v) => (v - low) / (high - low);
    const y = (value) => (spec.log && !(value > 0) ? NaN : MARGIN.top + (1 - unit(value)) * tall);
    const parts = [];
    for (const tick of spec.log ? logTicks(low, high) : linearTicks(low, high, 4)) {
      parts.push(svg("line", { class: "grid", x1: MARGIN.left, x2: width - MARGIN.right, y1: y(tick), y2: y(tick) }),
        svg("text", { x: MARGIN.left - 7, y: y(tick) + 4, "text-anchor": "end" }, plain(tick)));
    }
    const ticks = spec.ticks ?? linearTicks(x0, x1 > x0 ? x1 : x0 + 1, Math.min(8, count)).filter(Number.isInteger).map((v) => [v, String(v)]);
    const apart = Math.max(1, Math.ceil((ticks.length * 62) / inner));
    ticks.forEach(([value, name], k) => {
      if (value > x1 || k % apart) return;
      const anchor = ticks.length > 1 && k === ticks.length - 1 ? "end" : "middle";
      parts.push(svg("text", { x: x(value), y: height - MARGIN.bottom + 16, "text-anchor": anchor }, name));
    });
    if (spec.now !== undefined) parts.push(svg("line", { class: "now", x1: x(spec.now), x2: x(spec.now), y1: MARGIN.top, y2: MARGIN.top + tall }));
    parts.push(svg("text", { x: MARGIN.left + inner / 2, y: height - 3, "text-anchor": "middle" }, spec.xTitle));
    parts.push(svg("text", { x: 12, y: MARGIN.top + tall / 2, "text-anchor": "middle", transform: `rotate(-90 12 ${MARGIN.top + tall / 2})` }, spec.yTitle));
    spec.series.forEach(({ values, sd, part, at = 0 }, k) => {
      const colour = `var(--series-${(k % COLOURS) + 1})`, points = values.map((value, i) => [x(spec.x[at + i]), y(value)]);
      if (sd) {
        const up = values.map((v, i) => [x(spec.x[i]), y(v + sd[i])]).filter(([, b]) => Number.isFinite(b));
        const down = values.map((v, i) => [x(spec.x[i]), y(v - sd[i])]).filter(([, b]) => Number.isFinite(b)).reverse();
        if (up.length > 1 && up.length === down.length) parts.push(svg("path", { class: "band", style: `fill: ${colour}`, d: `${path([...up, ...down])}Z` }));
      }
      parts.push(svg("path", { class: "line", style: `stroke: ${colour}`, "stroke-dasharray": part ? "" : DASHES[k % 3], d: path(points) }));
      const dots = values.length < 40 ? points.filter(([, b]) => Number.isFinite(b)) : [];
      parts.push(...dots.map(([a, b]) => svg("circle", { cx: a, cy: b, r: 2.4, style: `fill: ${colour}` })));
    });
    if (spec.onpick) {
      const half = count > 1 ? inner / (count - 1) / 2 : inner / 2;
      spec.x.forEach((value, i) => {
        const left = Math.max(x(value) - half, 0), right = Math.min(x(value) + half, width);
        parts.push(svg("rect", {
          class: "hit", x: left, y: MARGIN.top, width: right - left, height: tall, onclick: () => spec.onpick(i),
        }, svg("title", {}, spec.hints?.[i] ?? "")));
      });
    }
    return svg("svg", { class: "chart", viewBox: `0 0 ${width} ${height}`, height, role: "img", "aria-label": spec.title }, parts);
  };

  /**
   * An element with a chart: { title, x, series: [{ name, values, sd, at, part }], xTitle, yTitle, log, fromZero, height,
   * ticks: [[value, text]], now, onpick(i), hints }.  `at` is the place of a series' first value in `x`; series that
   * are parts of one curve have `part: true` and no dashes.
   */
  gm.chart = (spec) => {
    const drawing = gm.el("div");
    const key = spec.series.length > 1 ? gm.el("div", { class: "key quiet" }, spec.series.map(({ name, part }, k) =>
      gm.el("span", {}, svg("svg", { width: 26, height: 10, "aria-hidden": "true" }, svg("line", {
        x1: 1, x2: 25, y1: 5, y2: 5, style: `stroke: var(--series-${(k % COLOURS) + 1}); stroke-width: 2`, "stroke-dasharray": part ? "" : DASHES[k % 3],
      })), ` ${name}`))) : null;
    const whole = gm.el("div", { class: "chart-box" }, key, drawing);
    new ResizeObserver(([{ contentRect }]) => {
      const width = Math.round(contentRect.width);
      if (width > 0 && width !== Number(drawing.dataset.width)) {
        drawing.dataset.width = width;
        drawing.replaceChildren(draw(spec, width));
      }
    }).observe(whole);
    return whole;
  };
})();
