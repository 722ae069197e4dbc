"use strict";
// The 3-D viewer: all grains, coloured and moved; a click chooses one.
(() => {
  const gm = (window.gm ??= {});
  const { el } = gm;
  const MOTION = ["ux", "uy", "uz", "wx", "wy", "wz"];
  const NO_STATUS = 255;
  const WEAK_COLOUR = [236, 112, 20]; // of weak directions: stands out from the maps and from both themes
  const LOST = "This browser draws no 3-D graphics at present (WebGL is off, or was lost). All numbers are in the table "
    + "below, and choosing a grain there works as ever. To see the grains here, switch hardware acceleration on in the "
    + "browser's settings, or open the page in another browser, and load it again.";

  const wide = (centers, radii) => {
    const low = [Infinity, Infinity, Infinity], high = [-Infinity, -Infinity, -Infinity];
    radii.forEach((radius, i) => {
      for (let k = 0; k < 3; k++) {
        if (!Number.isFinite(centers[3 * i + k])) continue;
        low[k] = Math.min(low[k], centers[3 * i + k] - radius);
        high[k] = Math.max(high[k], centers[3 * i + k] + radius);
      }
    });
    return low[0] <= high[0] ? { low, high } : { low: [-1, -1, -1], high: [1, 1, 1] };
  };

  const cssColour = (element, name) => {
    const text = getComputedStyle(element).getPropertyValue(name).trim();
    return /^#[0-9a-f]{6}$/i.test(text) ? gm.colours.rgb(text) : [90, 140, 220];
  };

  /** Mount the viewer in an element; a promise that is settled once the grains are there. */
  const mount = async (element, app) => {
    const stage = el("div", { class: "viewer-stage" });
    const tip = el("div", { class: "viewer-tip", hidden: true }), triad = gm.viewerCamera.triad();
    element.replaceChildren(stage);
    let canvas;
    const handlers = { draw() {}, pick: () => -1, choose() {}, hover() {}, step() {}, coarse() {}, look() {} };
    try {
      canvas = gm.viewerCanvas.create(stage, handlers);
    } catch {
      element.replaceChildren(el("p", { class: "viewer-lost", role: "status" }, LOST));
      return;
    }
    const lost = el("p", { class: "viewer-lost", role: "status", hidden: true }, LOST);
    canvas.canvas.addEventListener("webglcontextlost", () => { lost.hidden = false; });
    canvas.canvas.addEventListener("webglcontextrestored", () => { lost.hidden = true; canvas.request(); });
    const { renderer, view } = canvas;
    const { data } = app, labels = data.grains.labels;
    const settings = {
      colour: data.states.length ? "u" : "status", arrows: "none", share: 1, magnification: 1, relative: false,
      cutAxis: "", cutPlace: 0.5, cutThickness: 1,
    };
    const names = data.scene.bodies.map((body) => body.name).join(", ");
    const hidden = new Set(), ranges = new Map(); // numbers of hidden statuses; [low, high] given by the user

    const [centers, shapes] = await Promise.all([gm.decode(data.grains.centers), gm.viewerShapes.load(data)]);
    const grains = gm.viewerGrains.create(shapes, centers);
    const { low, high } = wide(centers, shapes.radii);
    const size = Math.hypot(...high.map((v, k) => v - low[k]));
    const overlays = gm.viewerOverlays.create(grains, data.scene.box, size);
    const bodies = await gm.viewerBodies.create(data.scene, grains.uniforms);
    const scene = new THREE.Scene();
    scene.add(grains.group, overlays.group, bodies.group);
    /** Look at all grains where they are now, from one of the views. */
    const look = (name) => {
      const now = wide(grains.places, shapes.radii);
      view.frame(now.low.map((v, k) => (v + now.high[k]) / 2), Math.hypot(...now.high.map((v, k) => v - now.low[k])) / 2);
      view.view(name);
    };

    let values = null, colours = null, numbers = null, moved = null, used = null, range = [0, 1], hovered = -1, turn = 0;
    const row = () => (app.grain === null ? -1 : app.row(app.grain));
    const titles = gm.viewerPanel.titles(data.quantities);
    const quantity = () => ({ ...app.quantity(settings.colour), title: titles.get(settings.colour) });
    const legend = gm.viewerLegend.create((own) => {
      if (own) ranges.set(settings.colour, own);
      else ranges.delete(settings.colour);
      refresh("colour");
    });
    const weakNote = el("p", { class: "quiet viewer-note", hidden: true }, "Orange: the directions in which the chosen "
      + "grain's motion is known least, of its translation an arrow to both sides, of its rotation an axis with a circle.");
    const help = el("details", { class: "viewer-help" }, el("summary", {}, "Mouse and keys"), gm.viewerCanvas.HELP);
    const told = el("p", { class: "quiet viewer-note", "aria-live": "polite" });

    const motionNow = async () => {
      const { state } = app, relative = settings.relative;
      const columns = state < 0 ? MOTION.map(() => new Float32Array(labels.length))
        : await Promise.all(MOTION.map((key) => app.column(state, key)));
      if (state < 0) return [new Uint8Array(labels.length).fill(NO_STATUS), gm.viewerMotion.motions(centers, columns, relative)];
      const [statusNumbers, u, w] = await Promise.all([app.status(state), app.ok(state, "translation"), app.ok(state, "rotation")]);
      return [statusNumbers, gm.viewerMotion.motions(centers, columns, relative, u), { u, w }];
    };
    const coloursNow = async (statusNumbers) => {
      const { state, theme } = app, { key, kind } = quantity(), map = gm.viewerLegend.mapName(quantity());
      const shown = state < 0 ? new Float32Array(labels.length).fill(NaN) : await app.usable(state, key);
      if (map === null) return [shown, gm.viewerScale.statusColours(statusNumbers, data.statuses, theme), [0, 1]];
      const all = await Promise.all(data.states.map((_, index) => app.usable(index, key)));
      const now = ranges.get(key) ?? gm.viewerScale.robustRange(all, kind);
      return [shown, gm.viewerScale.colours(shown, gm.colours.map(map), now, theme), now];
    };
    const place = () => {
      grains.hidden.forEach((_, i) => { grains.hidden[i] = hidden.has(numbers[i]) ? 1 : 0; });
      const factor = settings.share * settings.magnification;
      grains.setPoses(moved, factor);
      bodies.move(app.state, settings.relative ? 0 : factor);
    };
    const mark = async () => {
      const now = row();
      grains.mark(now, hovered);
      const state = app.state;
      const parts = now < 0 || state < 0 ? null : { translation: await app.weak(state, "translation"), rotation: await app.weak(state, "rotation") };
      if (now !== row() || state !== app.state) return;
      weakNote.hidden = !overlays.showWeak(now < 0 ? 0 : now, parts, WEAK_COLOUR);
      canvas.request();
    };
    const cut = () => {
      const k = "xyz".indexOf(settings.cutAxis);
      if (!settings.cutAxis) { grains.cut(null); return; }
      const ends = [centers, centers.map((value, i) => value + moved.shifts[i])].map((at) => wide(at, shapes.radii));
      const first = Math.min(...ends.map((box) => box.low[k])), length = Math.max(...ends.map((box) => box.high[k])) - first;
      const edge = first + settings.cutPlace * length;
      const far = settings.cutThickness >= 1 ? Infinity : edge + settings.cutThickness * length;
      grains.cut([0, 1, 2].map((j) => (j === k ? 1 : 0)), edge, Math.min(far, 1e9));
    };
    const arrows = () => {
      const vectors = { none: null, u: moved.shifts, w: moved.turns }[settings.arrows];
      const results = used?.[settings.arrows]; // an arrow would make a motion that is none look like one
      const shown = labels.map((_, i) => i).filter((i) => moved.known[i] && !grains.hidden[i] && (!results || results[i]));
      const factor = overlays.showArrows(vectors, shown, colours);
      grains.uniforms.size.value = vectors ? 0.4 : 1; // grains give way to their arrows
      return vectors ? factor : null;
    };
    const tell = (factor) => {
      const sentences = [];
      if (settings.magnification > 1) {
        sentences.push(`Translations and rotations are magnified ${settings.magnification} times; each grain turns about its own centre.`);
      }
      if (settings.relative) sentences.push("Motions are relative to the sample: the rigid motion that fits all grains' centres best is taken off.");
      if (factor !== null) sentences.push(settings.arrows === "u"
        ? `Arrows are ${gm.significant(factor, 1)} times as long as the displacements; grains are drawn at 40 % of their size.`
        : `Arrows are rotation vectors, ${gm.significant(factor * Math.PI / 180, 2)} mm for each degree; grains are drawn at 40 % of their size.`);
      const unknown = moved.known.filter((known) => !known).length;
      if (unknown && app.state >= 0) {
        const [have, are] = unknown === 1 ? ["grain has", "is"] : ["grains have", "are"];
        const where = unknown < labels.length ? "moved with the sample as a whole" : "in the places of the reference";
        sentences.push(`${unknown} ${have} no measured motion and ${are} drawn ${where}.`);
      }
      if (names) sentences.push(`Translucent bodies: ${names}${settings.relative ? ", in their places of the reference" : ""}.`);
      const text = sentences.join(" ");
      if (told.textContent !== text) told.textContent = text;
    };

    const changed = new Set(); // what has changed and is not drawn yet
    /** Bring what is drawn up to date after a change; of several at a time the last one draws them all. */
    const refresh = async (what) => {
      changed.add(what);
      const own = ++turn, has = (...names) => names.some((name) => changed.has(name));
      const motion = has("all", "state", "relative") ? await motionNow() : [numbers, moved, used];
      const shades = has("all", "state", "colour") ? await coloursNow(motion[0]) : [values, colours, range];
      if (own !== turn) return;
      changed.clear();
      [numbers, moved, used] = motion;
      [values, colours, range] = shades;
      place();
      cut();
      grains.setColours(colours);
      const factor = arrows();
      legend.update(quantity(), range, ranges.has(settings.colour), app.state >= 0 && values.some(Number.isNaN));
      statuses.update(numbers);
      statuses.element.hidden = app.state < 0;
      tell(factor);
      await mark();
      canvas.request();
    };

    handlers.look = look;
    handlers.draw = () => {
      triad.update(view.camera);
      grains.cap.update(renderer, view.camera);
      renderer.render(scene, view.camera);
    };
    const still = el("canvas", { class: "viewer-still", "aria-hidden": "true" }); // paper cannot show a WebGL canvas
    window.addEventListener("beforeprint", () => {
      handlers.draw();
      Object.assign(still, { width: canvas.canvas.width, height: canvas.canvas.height });
      still.getContext("2d").drawImage(canvas.canvas, 0, 0);
      stage.prepend(still);
    });
    window.addEventListener("afterprint", () => still.remove());
    handlers.pick = (x, y, coarsely) => grains.pick(renderer, view.camera, x, y, coarsely);
    handlers.coarse = grains.setCoarse;
    handlers.choose = (at) => app.setGrain(at < 0 ? null : labels[at]);
    handlers.step = (by) => {
      const shown = labels.map((_, i) => i).filter((i) => !grains.hidden[i]);
      if (!shown.length) return;
      const at = shown.indexOf(row());
      app.setGrain(labels[shown[at < 0 ? (by > 0 ? 0 : shown.length - 1) : (at + by + shown.length) % shown.length]]);
    };
    handlers.hover = (at, x, y) => {
      if (at !== hovered) {
        hovered = at;
        grains.mark(row(), hovered);
        canvas.canvas.style.cursor = at < 0 ? "" : "pointer";
        canvas.request();
      }
      tip.hidden = at < 0;
      if (at < 0) return;
      const { kind, title, unit } = quantity();
      const status = data.statuses[numbers[at]]?.name ?? "no status";
      const text = kind === "categorical" ? status
        : Number.isNaN(values[at]) && app.state >= 0 ? `${title}: no result to use (${status})`
        : `${title}: ${gm.quantityText(quantity(), values[at], data.length_decimals)}${unit ? ` ${unit}` : ""}`;
      tip.replaceChildren(el("b", {}, `Grain ${labels[at]}`), el("br"), text);
      tip.style.left = `${Math.min(x + 14, stage.clientWidth - tip.offsetWidth - 6)}px`;
      tip.style.top = `${y > 70 ? y - tip.offsetHeight - 10 : y + 18}px`;
    };
    const save = () => {
      handlers.draw();
      const picture = el("canvas", {}), { width, height } = canvas.canvas;
      Object.assign(picture, { width, height });
      const context = picture.getContext("2d"), style = getComputedStyle(element);
      context.fillStyle = style.getPropertyValue("--panel");
      context.fillRect(0, 0, width, height);
      context.drawImage(canvas.canvas, 0, 0);
      gm.viewerLegend.paint(context, height, quantity(), range, style.getPropertyValue("--ink"));
      picture.toBlob((blob) => {
        const link = el("a", { href: URL.createObjectURL(blob), download: `grains-${data.states[app.state]?.name ?? "reference"}-${settings.colour}.png` });
        link.click();
        setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
      }, "image/png");
    };

    const statuses = gm.viewerPanel.statusButtons(data.statuses, hidden, () => refresh("motion"));
    const panel = gm.viewerPanel.create(app, settings, refresh, { view: look, save });
    const theme = () => {
      const [accent, line] = ["--accent", "--quiet"].map((name) => cssColour(element, name));
      grains.uniforms.accent.value.set(...accent.map((c) => (c / 255) ** 2.2));
      const [lineColour, bodyColour] = [line, accent].map((colour) => new THREE.Color(...colour.map((c) => (c / 255) ** 2.2)));
      overlays.setColour(lineColour);
      bodies.setColour(bodyColour);
    };
    stage.append(triad.element, legend.element, tip, lost);
    element.replaceChildren(panel.top, stage, panel.bottom, statuses.element, told, weakNote, help);
    theme();
    app.on("state", () => refresh("state"));
    app.on("grain", mark);
    app.on("theme", () => { theme(); refresh("colour"); });
    await refresh("all");
    view.resize(stage.clientWidth, stage.clientHeight);
    look("default");
    gm.viewer.shown = { grains, bodies, view, canvas, settings, scene }; // for tests and measurements
    element.dataset.drawn = "yes";
  };

  gm.viewer = { mount };
})();
