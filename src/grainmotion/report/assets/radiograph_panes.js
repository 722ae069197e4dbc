"use strict";
// The pictures of one view on canvases: one with a divider between two kinds of image, or one for each kind.
(() => {
  const gm = (globalThis.gm ??= {});
  const CRISP = 3; // screen pixels a pixel from which on pixels are drawn as squares
  const SELECTED = "#ffd000"; // seen on grey as well as on blue and red

  /**
   * `shown` is what to draw, and may change between calls of `draw`: { view, painted: {kind: canvas}, masked (whether
   * some pixels are), outline, label, mode: "wipe" or "side", left, right } with kinds of image; `clicked` and `pointed` get points of the picture.
   */
  gm.radiographPanes = (shown, { clicked, pointed }) => {
    let divider = 0.5, panes = [];
    const stage = gm.el("div", { class: "stage" });
    const size = () => {
      const canvas = panes[0]?.canvas;
      return [canvas?.clientWidth || 1, canvas?.clientHeight || 1];
    };
    const zoom = gm.panZoom(size, () => draw());

    const handle = gm.el("div", {
      class: "divider", role: "slider", tabindex: 0, "aria-label": "divider between the two images",
      "aria-valuemin": 0, "aria-valuemax": 100, "aria-orientation": "horizontal",
    });
    const setDivider = (share) => {
      divider = Math.min(1, Math.max(0, share));
      draw();
    };
    handle.addEventListener("pointerdown", (event) => {
      handle.setPointerCapture(event.pointerId);
      handle.focus();
      event.preventDefault();
    });
    handle.addEventListener("pointermove", (event) => {
      if (!handle.hasPointerCapture(event.pointerId)) return;
      const area = stage.firstChild.getBoundingClientRect();
      setDivider((event.clientX - area.left) / area.width);
    });
    handle.addEventListener("keydown", (event) => {
      const step = event.shiftKey ? 0.1 : 0.02;
      const places = { ArrowLeft: divider - step, ArrowRight: divider + step, Home: 0, End: 1 };
      if (!(event.key in places)) return;
      setDivider(places[event.key]);
      event.preventDefault();
    });

    const pane = (kinds) => {
      const canvas = gm.el("canvas", { tabindex: 0, role: "img" });
      const names = kinds.map((kind, k) => gm.el("span", { class: k ? "name right" : "name" }, kind));
      zoom.listen(canvas, { clicked, pointed });
      return { kinds, canvas, element: gm.el("div", { class: "pane" }, canvas, names, kinds.length > 1 && handle) };
    };

    /** Put the canvases on the page that the mode asks for. */
    const arrange = () => {
      const wipe = shown.mode === "wipe";
      panes = (wipe ? [[shown.left, shown.right]] : [["measured"], ["simulated"], ["residual"]]).map(pane);
      stage.className = wipe ? "stage" : "stage side";
      stage.replaceChildren(...panes.map((each) => each.element));
      resize();
    };

    const resize = () => {
      if (!panes.length || !shown.view) return;
      const { rows, columns } = shown.view, width = panes[0].element.clientWidth;
      const height = Math.min(Math.max((width * rows) / columns, 120), 0.72 * window.innerHeight);
      for (const { canvas } of panes) canvas.style.height = `${Math.round(height)}px`;
      zoom.resize(columns, rows);
    };

    const draw = () => {
      if (shown.view) panes.forEach(drawPane);
    };

    const drawPane = ({ canvas, kinds }) => {
      const [width, height] = size(), ratio = window.devicePixelRatio || 1;
      canvas.width = Math.round(width * ratio);
      canvas.height = Math.round(height * ratio);
      canvas.style.touchAction = zoom.at.whole ? "pan-y" : "none"; // a finger scrolls the page or moves the picture
      const wipe = kinds.length > 1, cut = divider * width;
      canvas.setAttribute("aria-label", `${kinds.join(" and ")} radiograph, ${shown.view.caption}`);
      const context = canvas.getContext("2d");
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
      kinds.forEach((kind, k) => {
        context.save();
        context.beginPath();
        context.rect(wipe && k ? cut : 0, 0, wipe ? (k ? width - cut : cut) : width, height);
        context.clip();
        drawImage(context, kind);
        context.restore();
      });
      drawSelected(context);
      if (!wipe) return;
      context.fillStyle = "#fff";
      context.fillRect(cut - 1, 0, 2, height);
      handle.style.left = `${100 * divider}%`;
      handle.setAttribute("aria-valuenow", Math.round(100 * divider));
      handle.setAttribute("aria-valuetext", `${Math.round(100 * divider)} % ${kinds[0]}, the rest ${kinds[1]}`);
    };

    const drawImage = (context, kind) => {
      const { scale, x, y } = zoom.at, { rows, columns, binning: k } = shown.view, image = shown.painted[kind];
      context.beginPath();
      context.rect(x, y, columns * scale, rows * scale);
      context.clip();
      if (shown.masked) gm.radiographImages.hatch(context, ...size());
      context.imageSmoothingEnabled = scale * k < CRISP;
      context.imageSmoothingQuality = "high";
      context.drawImage(image, x, y, image.width * k * scale, image.height * k * scale);
    };

    const drawSelected = (context) => {
      const { outline, label } = shown;
      if (!outline?.length) return;
      gm.footprints.draw(context, outline, zoom.toCanvas, SELECTED);
      const { left, right, top } = gm.projection.box(outline);
      const [x, y] = zoom.toCanvas([(left + right) / 2, top]);
      context.font = "600 13px system-ui, sans-serif";
      context.textAlign = "center";
      context.lineWidth = 4;
      context.strokeStyle = "rgb(0 0 0 / 0.75)";
      context.fillStyle = SELECTED;
      for (const write of ["strokeText", "fillText"]) context[write](label, x, Math.max(y - 8, 14));
    };

    new ResizeObserver(resize).observe(stage);
    return { stage, zoom, arrange, resize, draw };
  };
})();
