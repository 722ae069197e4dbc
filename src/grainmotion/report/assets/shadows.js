"use strict";
// The shadow of the selected grain in each view of the state: measured, simulated and residual, cut out around it.
(() => {
  const gm = (globalThis.gm ??= {});
  const KINDS = ["measured", "simulated", "residual"];
  const WIDTH = 150; // of a cut-out, CSS pixels
  const LEAST_MARGIN = 3; // pixels of the picture around the footprint
  const MARGIN = 0.25; // of the footprint's size around it
  const COARSE = 12; // pixels of the picture across a footprint below which little is to be seen
  const SELECTED = "#ffd000";

  /** The part of the panel around an outline: { left, top, width, height } in pixels; null if it lies outside. */
  function around(outline, view) {
    const { left, right, top, bottom } = gm.projection.box(outline);
    if (right < 0 || bottom < 0 || left > view.columns - 1 || top > view.rows - 1) return null;
    const margin = Math.max(LEAST_MARGIN * view.binning, MARGIN * Math.max(right - left, bottom - top));
    return { left: left - margin, top: top - margin, width: right - left + 2 * margin, height: bottom - top + 2 * margin };
  }

  /** Blocks of an image that hold a part of the panel, and where their first pixel lies: { values, width, height, x, y }. */
  function cut(values, images, part, binning) {
    const clip = (at, most) => Math.min(Math.max(Math.floor(at / binning), 0), most);
    const left = clip(part.left, images.width - 1), right = clip(part.left + part.width, images.width - 1) + 1;
    const top = clip(part.top, images.height - 1), bottom = clip(part.top + part.height, images.height - 1) + 1;
    const width = right - left, height = bottom - top, taken = new Float32Array(width * height);
    for (let k = 0; k < height; k++) {
      const start = (top + k) * images.width + left;
      taken.set(values.subarray(start, start + width), k * width);
    }
    return { values: taken, width, height, x: left * binning, y: top * binning };
  }

  /** Lowest and highest value of the measured and the simulated image in a part of the panel. */
  function range(images, part, binning) {
    let low = Infinity, high = -Infinity;
    for (const kind of ["measured", "simulated"]) {
      for (const value of cut(images[kind], images, part, binning).values) {
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    return high > low ? [low, high] : [0, 1];
  }

  function crop(kind, images, ends, { part, outline, view, label }) {
    const taken = cut(images[kind], images, part, view.binning);
    const { map } = gm.radiographImages.KINDS[kind];
    const picture = gm.radiographImages.paint(taken.values, taken.width, taken.height, map, ...ends);
    const ratio = Math.min(2, window.devicePixelRatio || 1), scale = (WIDTH * ratio) / Math.max(part.width, part.height);
    const canvas = gm.el("canvas", {
      width: Math.round(part.width * scale), height: Math.round(part.height * scale), role: "img",
      "aria-label": `${kind} shadow of grain ${label}, ${view.caption}`,
    });
    const context = canvas.getContext("2d"), k = view.binning;
    const place = ([x, y]) => [(x + 0.5 - part.left) * scale, (y + 0.5 - part.top) * scale];
    context.save();
    context.beginPath();
    context.rect(...place([-0.5, -0.5]), view.columns * scale, view.rows * scale);
    context.clip();
    gm.radiographImages.hatch(context, canvas.width, canvas.height);
    context.imageSmoothingEnabled = false;
    const corner = place([taken.x - 0.5, taken.y - 0.5]);
    context.drawImage(picture, ...corner, picture.width * k * scale, picture.height * k * scale);
    context.restore();
    gm.footprints.draw(context, outline, place, SELECTED);
    return canvas;
  }

  async function ofView(view, outline, limit, label) {
    const part = outline.length > 2 ? around(outline, view) : null;
    const caption = gm.el("h4", {}, view.caption);
    if (!part) return gm.el("div", { class: "shadow" }, caption, gm.el("p", { class: "quiet" }, "not on the panel"));
    const images = await gm.radiographImages.of(view), [low, high] = range(images, part, view.binning);
    const across = Math.min(part.width, part.height) / (1 + 2 * MARGIN) / view.binning;
    const coarse = across < COARSE && view.binning > 1;
    const cuts = KINDS.map((kind) => {
      const ends = gm.radiographImages.ends(kind, { low, high, limit });
      return crop(kind, images, ends, { part, outline, view, label });
    });
    const text = coarse ? `Coarse: ${gm.radiographImages.averaging(view)}.` : null;
    return gm.el("div", { class: "shadow" }, caption, gm.el("div", { class: "cuts" }, cuts), text && gm.el("p", { class: "quiet" }, text));
  }

  function mount(element, app) {
    let turn = 0;
    const { limit } = gm.radiographImages.scales(app.data);
    const say = (text) => element.replaceChildren(gm.el("h3", {}, "Shadows"), gm.el("p", { class: "quiet" }, text));

    async function show() {
      const mine = ++turn, state = app.data.states[app.state], row = app.grain === null ? -1 : app.row(app.grain);
      if (!state || row < 0) return element.replaceChildren();
      const views = state.views.filter((view) => view.images && view.geometry);
      if (!views.length) return say("This report holds no radiographs of this state with their geometry.");
      const prints = await gm.footprints.of(app, app.state);
      if (mine !== turn) return;
      if (!prints.center(row, views[0])) return say("This grain has no place in this state.");
      const shadows = await Promise.all(views.map((view) => ofView(view, prints.outline(row, view), limit, app.grain)));
      if (mine !== turn) return;
      element.replaceChildren(
        gm.el("h3", {}, `Shadows of grain ${app.grain}`),
        gm.el("p", { class: "quiet" }, "From left to right: measured, simulated, residual (blue to red: " +
          `±${gm.significant(limit)}). Yellow: the grain's outline where it was found.`),
        gm.el("div", { class: "shadow-list" }, shadows));
    }

    for (const event of ["grain", "state", "ready"]) app.on(event, show);
  }

  gm.shadows = { mount };
})();
