"use strict";
// The radiographs of a state: which view, two images with a divider or three side by side, contrast, values of pixels.
(() => {
  const gm = (globalThis.gm ??= {});
  const KINDS = ["measured", "simulated", "residual"];
  const THUMBNAIL = 112; // pixels across
  const HELP =
    "Drag to move; Ctrl and the wheel, or + and −, zoom; 0 shows all. Click a grain to select it, and again for the one " +
    "behind it. The divider is dragged, or moved by the arrow keys.";

  /** Choices of which one is taken; arrow keys go through them. */
  function choice(name, legend, options, chosen, changed) {
    const radios = options.map(({ value, content, className }) =>
      gm.el("label", { class: className },
        gm.el("input", { type: "radio", name, value, checked: value === chosen, onchange: () => changed(value) }), content));
    return gm.el("fieldset", { class: "choice" }, gm.el("legend", {}, legend), gm.el("div", {}, radios));
  }

  function select(label, value, changed) {
    const options = KINDS.map((kind) => gm.el("option", { value: kind, selected: kind === value }, kind));
    return gm.el("label", {}, `${label} `, gm.el("select", { onchange: (e) => changed(e.target.value) }, options));
  }

  function mount(element, app) {
    const shown = { mode: "wipe", left: "measured", right: "simulated", view: null, painted: {}, outline: [], label: "" };
    const standard = gm.radiographImages.scales(app.data), scale = { ...standard };
    let index = 0, images = null, footprints = null, hits = { point: null, rows: [] }, turn = 0;

    const picker = gm.el("div", { class: "view-picker" });
    const note = gm.el("p", { class: "quiet", id: "radiograph-note" });
    const readout = gm.el("output", { class: "readout", "aria-live": "off" });
    const panes = gm.radiographPanes(shown, { clicked, pointed });
    const sides = gm.el("span", { class: "sides" });
    const body = gm.el("div", { class: "radiograph-body" });
    const levels = gm.radiographLevels(app.data, scale, standard, () => {
      repaint();
      panes.draw();
    });
    const modes = choice("radiograph-mode", "show", [
      { value: "wipe", content: "two with a divider" }, { value: "side", content: "all three" },
    ], shown.mode, (mode) => {
      shown.mode = mode;
      arrange();
    });

    function arrange() {
      const pick = (side) => (kind) => {
        shown[side] = kind;
        panes.arrange();
      };
      const wipe = shown.mode === "wipe";
      sides.replaceChildren(...(wipe ? [select("left", shown.left, pick("left")), select("right", shown.right, pick("right"))] : []));
      panes.arrange();
    }

    const state = () => app.data.states[app.state];

    function repaint() {
      if (!images) return;
      for (const kind of KINDS) {
        const ends = gm.radiographImages.ends(kind, scale);
        shown.painted[kind] = gm.radiographImages.paint(
          images[kind], images.width, images.height, gm.radiographImages.KINDS[kind].map, ...ends);
      }
    }

    async function showView() {
      const mine = ++turn, view = state().views[index];
      const [read, prints] = await Promise.all([gm.radiographImages.of(view), gm.footprints.of(app, app.state)]);
      if (mine !== turn) return; // another one was asked for meanwhile
      const first = !shown.view;
      images = read;
      footprints = prints;
      shown.view = view;
      shown.masked = images.masked;
      repaint();
      outlineSelected();
      note.textContent = noteOn(view);
      readout.textContent = "\u00a0";
      if (first) arrange();
      else panes.resize();
      panes.draw();
      element.dataset.view = String(index);
    }

    function noteOn(view) {
      const misfit = view.percent === null ? "" : `, ${gm.significant(view.percent)} % of the measured one`;
      const fit = view.rms === null ? "" : ` Residual ${gm.significant(view.rms)} (root mean square)${misfit}.`;
      const places = view.geometry ? "" : " This report does not know the views' geometry, so grains are not marked.";
      const hatched = images.masked ? " Hatched pixels were left out of the fit." : "";
      const size = `${view.rows} × ${view.columns} pixels`;
      return `${view.caption}: ${size}, ${gm.radiographImages.averaging(view)}, z up.${fit}${hatched}${places}`;
    }

    function outlineSelected() {
      const row = app.grain === null ? -1 : app.row(app.grain);
      shown.outline = row < 0 || !shown.view ? [] : footprints.outline(row, shown.view);
      shown.label = `grain ${app.grain}`;
    }

    function clicked(point) {
      const again = hits.point && Math.hypot(point[0] - hits.point[0], point[1] - hits.point[1]) < 2 && hits.view === shown.view;
      const rows = again ? hits.rows : footprints.at(point, shown.view);
      hits = { point, rows, view: shown.view };
      if (!rows.length) return app.setGrain(null);
      const now = rows.findIndex((row) => app.data.grains.labels[row] === app.grain);
      app.setGrain(app.data.grains.labels[rows[again ? (now + 1) % rows.length : 0]]);
    }

    function pointed(point) {
      const { view } = shown, inside = point && view && images;
      const [column, row] = inside ? point.map(Math.round) : [-1, -1];
      if (column < 0 || row < 0 || column >= view.columns || row >= view.rows) return void (readout.textContent = "\u00a0");
      const k = Math.floor(row / view.binning) * images.width + Math.floor(column / view.binning);
      const value = (kind) => (Number.isNaN(images[kind][k]) ? "masked" : gm.fixed(images[kind][k], 4));
      const values = KINDS.map((kind) => `${kind} ${value(kind)}`).join(", ");
      readout.textContent = `row ${gm.projection.ownRow(view, row)}, column ${column}: ${values}`;
    }

    async function thumbnail(view, canvas) {
      const read = await gm.radiographImages.of(view);
      const { low, high } = standard;
      const image = gm.radiographImages.paint(read.measured, read.width, read.height, "grey", low, high);
      canvas.height = Math.max(1, Math.round((canvas.width * view.rows) / view.columns));
      const context = canvas.getContext("2d");
      context.imageSmoothingQuality = "high";
      if (read.masked) gm.radiographImages.hatch(context, canvas.width, canvas.height);
      context.drawImage(image, 0, 0, canvas.width, canvas.height);
    }

    function showState() {
      const { views, name } = state();
      if (!views.some((view) => view.images)) {
        turn++;
        const text = views.length
          ? `The radiographs of ${name} are left out to keep this page small: its residuals are in ${name}/residuals.tif.`
          : `${name} has no radiographs.`;
        picker.replaceChildren();
        return body.replaceChildren(gm.el("p", {}, text));
      }
      index = Math.min(index, views.length - 1);
      const options = views.map((view, k) => {
        const canvas = gm.el("canvas", { width: THUMBNAIL, height: THUMBNAIL, "aria-hidden": "true" });
        thumbnail(view, canvas);
        return { value: String(k), className: "thumbnail", content: [canvas, gm.el("span", {}, view.caption)] };
      });
      picker.replaceChildren(choice("radiograph-view", "view", options, String(index), (k) => {
        index = Number(k);
        showView();
      }));
      body.replaceChildren(
        gm.el("div", {}, gm.el("div", { class: "toolbar" }, modes, sides, panes.zoom.buttons()), panes.stage, readout),
        gm.el("aside", { "aria-label": "contrast and notes" }, levels, note, gm.el("p", { class: "quiet help" }, HELP)));
      shown.view = null;
      showView();
    }

    element.replaceChildren(picker, body);
    app.on("state", showState);
    app.on("grain", () => {
      outlineSelected();
      panes.draw();
    });
    app.on("ready", showState);
  }

  gm.radiographs = { mount };
})();
