"use strict";
// Slices of the reference with the outlines of its grains: three planes, each with a slider.
(() => {
  const gm = (globalThis.gm ??= {});
  const OUTLINE = "#2a9dff", SELECTED = "#ffd000", CROSS = "rgb(255 255 255 / 0.35)";

  /** Ends of the lines between pixels of different values, one after another: x, y, x, y, ... */
  function borders(values, width, height, wanted = null) {
    const ends = [];
    const differ = (a, b) => a !== b && (wanted === null || a === wanted || b === wanted);
    for (let y = 0; y < height; y++) {
      for (let x = 0; x < width; x++) {
        const here = values[y * width + x];
        if (x + 1 < width && differ(here, values[y * width + x + 1])) ends.push(x + 1, y, x + 1, y + 1);
        if (y + 1 < height && differ(here, values[(y + 1) * width + x])) ends.push(x, y + 1, x + 1, y + 1);
      }
    }
    return ends;
  }

  async function plane(record, levels, app, moved) {
    const [grey, stored] = await Promise.all([gm.decode(record.grey), record.grains && gm.decode(record.grains)]);
    const [count, height, width] = grey.shape, area = width * height;
    const rows = stored && gm.radiographImages.addRows(stored.slice(), width, height);
    const { axis, across, up, positions } = record;
    const canvas = gm.el("canvas", { role: "img" });
    const text = gm.el("output", {});
    const slider = gm.el("input", { type: "range", min: 0, max: count - 1, step: 1, "aria-label": `place of the slice along ${axis}` });
    const readout = gm.el("p", { class: "quiet readout" }, "\u00a0");
    let current = count >> 1;

    const grainAt = (event) => {
      const box = canvas.getBoundingClientRect();
      const x = Math.floor(((event.clientX - box.left) / box.width) * (record.size[0] / record.pixel));
      const y = Math.floor(((event.clientY - box.top) / box.height) * (record.size[1] / record.pixel));
      const inside = rows && x >= 0 && y >= 0 && x < width && y < height;
      const row = inside ? rows[current * area + y * width + x] : 0;
      return row ? app.data.grains.labels[row - 1] : null;
    };

    const stroke = (context, ends, scale, style, thickness) => {
      context.beginPath();
      for (let k = 0; k < ends.length; k += 4) {
        context.moveTo(ends[k] * scale, ends[k + 1] * scale);
        context.lineTo(ends[k + 2] * scale, ends[k + 3] * scale);
      }
      context.strokeStyle = style;
      context.lineWidth = thickness;
      context.lineCap = "round";
      context.stroke();
    };

    const here = () => [current * area, (current + 1) * area];
    let drawn = null, drawnAs = ""; // the slice with its outlines, kept while only the other planes move

    const slice = (size, scale, ratio, outlined) => {
      const as = [current, ...size, outlined].join();
      if (as === drawnAs) return drawn;
      drawnAs = as;
      drawn = gm.el("canvas", { width: size[0], height: size[1] });
      const context = drawn.getContext("2d");
      const image = gm.radiographImages.paint(grey.subarray(...here()), width, height, "grey", 0, levels - 1);
      context.imageSmoothingEnabled = scale < 3;
      context.drawImage(image, 0, 0, width * scale, height * scale);
      if (outlined && rows) stroke(context, borders(rows.subarray(...here()), width, height), scale, OUTLINE, 1.6 * ratio);
      return drawn;
    };

    const draw = (cross, outlined) => {
      const ratio = window.devicePixelRatio || 1, shown = canvas.clientWidth || 300;
      const scale = (shown * ratio * record.pixel) / record.size[0]; // canvas pixels a pixel of the slice
      canvas.width = Math.round(shown * ratio);
      canvas.height = Math.round((canvas.width * record.size[1]) / record.size[0]);
      const context = canvas.getContext("2d");
      context.drawImage(slice([canvas.width, canvas.height], scale, ratio, outlined), 0, 0);
      const x = (cross[across] - record.left) / record.pixel, y = (record.top - cross[up]) / record.pixel;
      stroke(context, [x, 0, x, height, 0, y, width, y], scale, CROSS, ratio);
      if (rows && app.grain !== null) {
        const ends = borders(rows.subarray(...here()), width, height, app.row(app.grain) + 1);
        stroke(context, ends, scale, SELECTED, 2.5 * ratio);
      }
      slider.value = current;
      const place = `${axis} = ${gm.significant(positions[current])} mm`;
      text.textContent = place;
      slider.setAttribute("aria-valuetext", place);
      canvas.setAttribute("aria-label", `slice of the reference at ${place}, ${across} to the right, ${up} upwards`);
    };

    slider.addEventListener("input", () => {
      current = Number(slider.value);
      moved();
    });
    canvas.addEventListener("click", (event) => app.setGrain(grainAt(event)));
    canvas.addEventListener("pointermove", (event) => {
      const label = grainAt(event);
      readout.textContent = label === null ? "\u00a0" : `grain ${label}`;
      canvas.style.cursor = label === null ? "default" : "pointer";
    });
    canvas.addEventListener("pointerleave", () => (readout.textContent = "\u00a0"));
    const averaged = record.binning > 1 ? `, averaged over ${record.binning} × ${record.binning} voxels` : "";
    const caption = gm.el("figcaption", {}, `${across} →, ${up} ↑, `, text, averaged);
    return {
      axis, draw,
      element: gm.el("figure", {}, canvas, slider, caption, readout),
      position: () => positions[current],
      /** Show the slice nearest to a place along the axis, mm. */
      moveTo(place) {
        if (!Number.isFinite(place)) return;
        for (let k = 0; k < count; k++) if (Math.abs(positions[k] - place) < Math.abs(positions[current] - place)) current = k;
      },
    };
  }

  async function mount(element, app) {
    const { slices } = app.data;
    if (!slices) return;
    const outlines = gm.el("input", { type: "checkbox", checked: true });
    const centers = await gm.decode(app.data.grains.centers);
    const planes = await Promise.all(slices.planes.map((record) => plane(record, slices.levels, app, () => draw())));
    const draw = () => {
      const cross = Object.fromEntries(planes.map((each) => [each.axis, each.position()]));
      for (const each of planes) each.draw(cross, outlines.checked);
    };
    outlines.addEventListener("change", () => draw());
    const [low, high] = slices.range;
    element.replaceChildren(
      gm.el("div", { class: "toolbar" },
        slices.planes[0].grains && gm.el("label", {}, outlines, " outlines of the grains"),
        gm.el("span", { class: "quiet" }, `black to white: attenuation ${gm.significant(low)} to ${gm.significant(high)} 1/mm; faint lines: the other slices; a click selects a grain`)),
      gm.el("div", { class: "planes" }, planes.map((each) => each.element)));
    app.on("grain", () => {
      const row = app.grain === null ? -1 : app.row(app.grain);
      if (row >= 0) for (const each of planes) each.moveTo(centers[3 * row + "xyz".indexOf(each.axis)]);
      draw();
    });
    new ResizeObserver(draw).observe(element);
    element.dataset.ready = "yes";
  }

  gm.slices = { mount };
})();
