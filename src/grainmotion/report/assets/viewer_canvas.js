"use strict";
// The canvas: draws only when something changed, and turns mouse, touch and keys into views and chosen grains.
(() => {
  const gm = (window.gm ??= {});
  const { el } = gm;
  const HELP = "Drag turns, right button or two fingers shift, wheel or + and − zoom, arrow keys turn, [ and ] go to the "
    + "previous and next grain, a click chooses a grain, Escape lets go of it, 0 resets the view.";
  const SLACK = { mouse: 4, touch: 12 }; // pixels by which a mouse may move in a click, and a finger in a tap
  const TURN = 6, ZOOM = 1.15; // degrees and factor of a key
  const SLOW = 60; // ms between frames from which fewer pixels and triangles are drawn while the view turns
  const MAX_RATIO = 2; // of pixels drawn to CSS pixels

  /**
   * A canvas in `element`: { canvas, renderer, view, request, frames }.  `handlers`: pick(x, y, coarsely) gives a row,
   * choose(row), hover(row, x, y), step(±1), draw() draws the scene, coarse(yes) with few or all triangles, look(name)
   * shows all grains from one of the views.  Throws where there is no WebGL.
   */
  const create = (element, handlers) => {
    const canvas = el("canvas", {
      tabindex: 0, role: "img", "aria-label": `Grains in 3-D. ${HELP}`,
      "aria-keyshortcuts": "ArrowLeft ArrowRight ArrowUp ArrowDown + - [ ] 0 Escape",
    });
    const renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true, powerPreference: "high-performance" });
    renderer.setClearColor(0x000000, 0);
    element.append(canvas);
    let requested = false, coarse = false, isSlow = false, last = 0, slow = 0, frames = 0;
    const view = gm.viewerCamera.create(canvas, () => request());
    const ratio = () => Math.min(window.devicePixelRatio || 1, MAX_RATIO) * (coarse ? 0.6 : 1);

    const resize = () => {
      const width = element.clientWidth, height = element.clientHeight;
      if (!width || !height) return;
      renderer.setPixelRatio(ratio());
      renderer.setSize(width, height, false);
      view.resize(width, height);
      request();
    };
    const request = () => {
      if (requested) return;
      requested = true;
      requestAnimationFrame((now) => {
        requested = false;
        frames++;
        if (turning && isSlow && !coarse) setCoarse(true);
        handlers.draw();
        if (turning) adapt(now);
      });
    };
    const setCoarse = (value) => {
      coarse = value;
      slow = 0;
      handlers.coarse(value);
      resize();
    };
    /** Where frames come slowly while the view turns, draw less till it rests, and from then on whenever it turns. */
    const adapt = (now) => {
      const interval = now - last;
      last = now;
      if (coarse) return;
      slow = interval > SLOW ? slow + 1 : 0;
      isSlow ||= slow >= 3;
    };
    const rest = () => { if (coarse) setCoarse(false); };
    /** Row of the grain at a point; on slow machines by few triangles while the pointer only passes. */
    const pick = (x, y, passing) => {
      const start = performance.now(), row = handlers.pick(x, y, passing && isSlow);
      if (performance.now() - start > SLOW) isSlow = true;
      return row;
    };

    let turning = false, pressed = null, hovering = null;
    const place = (event) => {
      const box = canvas.getBoundingClientRect();
      return [event.clientX - box.left, event.clientY - box.top];
    };
    canvas.addEventListener("pointerdown", (event) => {
      pressed = event.isPrimary && event.button === 0 ? [event.clientX, event.clientY] : null;
      turning = true;
      last = performance.now();
      canvas.focus({ preventScroll: true });
      handlers.hover(-1);
    });
    canvas.addEventListener("pointerup", (event) => {
      turning = false;
      rest();
      if (pressed && Math.hypot(event.clientX - pressed[0], event.clientY - pressed[1]) <= (SLACK[event.pointerType] ?? SLACK.mouse)) {
        handlers.choose(pick(...place(event), false));
      }
      pressed = null;
    });
    canvas.addEventListener("pointercancel", () => { turning = false; pressed = null; rest(); });
    canvas.addEventListener("pointermove", (event) => {
      if (turning || event.pointerType === "touch") return;
      const waiting = hovering !== null;
      hovering = place(event);
      if (waiting) return;
      requestAnimationFrame(() => {
        if (hovering && !turning) handlers.hover(pick(...hovering, true), ...hovering);
        hovering = null;
      });
    });
    canvas.addEventListener("pointerleave", () => { hovering = null; handlers.hover(-1); });
    // the wheel scrolls the page until the view was clicked: nobody gets caught in it
    const hint = el("div", { class: "viewer-hint", hidden: true }, "Click the view, then the wheel zooms");
    element.append(hint);
    let hiding = 0;
    element.addEventListener("wheel", (event) => {
      if (event.ctrlKey || document.activeElement === canvas) return;
      event.stopPropagation();
      hint.hidden = false;
      clearTimeout(hiding);
      hiding = setTimeout(() => { hint.hidden = true; }, 1200);
    }, { capture: true });

    const keys = {
      ArrowLeft: () => view.turn(-TURN, 0), ArrowRight: () => view.turn(TURN, 0), ArrowUp: () => view.turn(0, TURN),
      ArrowDown: () => view.turn(0, -TURN), "+": () => view.zoom(1 / ZOOM), "=": () => view.zoom(1 / ZOOM),
      "-": () => view.zoom(ZOOM), "−": () => view.zoom(ZOOM), 0: () => handlers.look("default"),
      "[": () => handlers.step(-1), "]": () => handlers.step(1), Escape: () => handlers.choose(-1),
    };
    canvas.addEventListener("keydown", (event) => {
      const act = keys[event.key];
      if (!act || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      act();
    });
    new ResizeObserver(resize).observe(element);
    return { canvas, renderer, view, request, draw: () => handlers.draw(), frames: () => frames };
  };

  gm.viewerCanvas = { create, HELP };
})();
