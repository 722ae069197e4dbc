"use strict";
// Zoom and pan of pictures on canvases that show the same place.
(() => {
  const gm = (globalThis.gm ??= {});
  const STEP = 1.25; // of a button, a key or a notch of the wheel
  const MOST_PIXELS = 40; // of the screen for one of the picture
  const CLICK_REACH = { mouse: 4, touch: 12 }; // screen pixels within which a press and a release are a click or a tap

  /**
   * What part of a picture of `width` × `height` pixels canvases of `size()` = [width, height] CSS pixels show.
   * `changed()` is called when it moves.
   */
  gm.panZoom = (size, changed) => {
    const at = { scale: 1, x: 0, y: 0, whole: true, width: 1, height: 1 };

    /** Keep the picture on the canvas: it cannot be dragged out of sight. */
    const settle = () => {
      const [w, h] = size(), fit = Math.min(w / at.width, h / at.height);
      at.scale = Math.min(Math.max(at.scale, fit), Math.max(MOST_PIXELS, fit));
      at.whole = at.scale <= fit * 1.001;
      const keep = (offset, room, length) =>
        length <= room ? (room - length) / 2 : Math.min(0, Math.max(room - length, offset));
      at.x = keep(at.x, w, at.width * at.scale);
      at.y = keep(at.y, h, at.height * at.scale);
      changed();
    };

    const zoom = {
      at,
      /** Show the whole picture, whose size may be new. */
      fit(width = at.width, height = at.height) {
        Object.assign(at, { width, height, scale: 0 });
        settle();
      },
      /** Adapt to a new size of the canvases or of the picture. */
      resize(width, height) {
        const keep = !at.whole && width === at.width && height === at.height;
        if (keep) settle();
        else zoom.fit(width, height);
      },
      by(factor, [x, y] = size().map((n) => n / 2)) {
        const before = at.scale;
        const [w, h] = size(), fit = Math.min(w / at.width, h / at.height);
        at.scale = Math.min(Math.max(before * factor, fit), Math.max(MOST_PIXELS, fit));
        at.x = x - ((x - at.x) * at.scale) / before;
        at.y = y - ((y - at.y) * at.scale) / before;
        settle();
      },
      move(dx, dy) {
        at.x += dx;
        at.y += dy;
        settle();
      },
      /** Point of the picture, whose pixel (0, 0) is centred at [0, 0], to the canvas. */
      toCanvas: ([x, y]) => [at.x + (x + 0.5) * at.scale, at.y + (y + 0.5) * at.scale],
      toPicture: ([x, y]) => [(x - at.x) / at.scale - 0.5, (y - at.y) / at.scale - 0.5],

      /** Make a canvas zoom and pan; `clicked` and `pointed` get points of the picture, `pointed` null on leaving. */
      listen(canvas, { clicked, pointed }) {
        let pressed = null;
        const fingers = new Map(); // places of the pointers that are down, by their number
        /** Zoom and move as two fingers do, one of which has just moved from one place to another. */
        const pinch = (id, now) => {
          const other = [...fingers].find(([key]) => key !== id)[1], before = fingers.get(id);
          const apart = (point) => Math.hypot(point[0] - other[0], point[1] - other[1]);
          if (apart(before) > 0 && apart(now) > 0) zoom.by(apart(now) / apart(before), [0, 1].map((k) => (before[k] + other[k]) / 2));
          zoom.move((now[0] - before[0]) / 2, (now[1] - before[1]) / 2);
        };
        const place = (event) => {
          const box = canvas.getBoundingClientRect();
          return [event.clientX - box.left, event.clientY - box.top];
        };
        const release = ({ pointerId }) => {
          fingers.delete(pointerId);
          const [left] = fingers.values(); // one finger that stays goes on moving the picture, and taps nothing
          pressed = left ? { start: left, last: left, moved: true } : null;
        };
        canvas.addEventListener("wheel", (event) => {
          if (!event.ctrlKey && !event.metaKey && document.activeElement !== canvas) return; // the page scrolls
          event.preventDefault();
          zoom.by(STEP ** -Math.sign(event.deltaY), place(event));
        }, { passive: false });
        canvas.addEventListener("pointerdown", (event) => {
          if (event.button !== 0) return;
          fingers.set(event.pointerId, place(event));
          pressed = { start: place(event), last: place(event), moved: fingers.size > 1 };
          canvas.setPointerCapture(event.pointerId);
        });
        canvas.addEventListener("pointermove", (event) => {
          const now = place(event);
          if (fingers.size > 1 && fingers.has(event.pointerId)) pinch(event.pointerId, now);
          else if (pressed) {
            const { start, last } = pressed, reach = CLICK_REACH[event.pointerType] ?? CLICK_REACH.mouse;
            pressed.moved ||= Math.hypot(now[0] - start[0], now[1] - start[1]) > reach;
            if (pressed.moved) zoom.move(now[0] - last[0], now[1] - last[1]);
            pressed.last = now;
          }
          if (fingers.has(event.pointerId)) fingers.set(event.pointerId, now);
          pointed(zoom.toPicture(now));
        });
        canvas.addEventListener("pointerup", (event) => {
          if (pressed && !pressed.moved) clicked(zoom.toPicture(place(event)));
          release(event);
        });
        canvas.addEventListener("pointercancel", release);
        canvas.addEventListener("pointerleave", () => pointed(null));
        canvas.addEventListener("keydown", (event) => {
          const far = 40, moves = { ArrowLeft: [far, 0], ArrowRight: [-far, 0], ArrowUp: [0, far], ArrowDown: [0, -far] };
          if (event.ctrlKey || event.metaKey || event.altKey) return;
          if (event.key in moves) zoom.move(...moves[event.key]);
          else if (event.key === "+" || event.key === "=") zoom.by(STEP);
          else if (event.key === "-") zoom.by(1 / STEP);
          else if (event.key === "0") zoom.fit();
          else return;
          event.preventDefault();
          pointed(zoom.toPicture(size().map((n) => n / 2)));
        });
      },

      /** Buttons that zoom in, out and show the whole picture. */
      buttons: () =>
        gm.el("div", { class: "zoom-buttons", role: "group", "aria-label": "zoom" },
          gm.el("button", { type: "button", title: "zoom in (+)", "aria-label": "zoom in", onclick: () => zoom.by(1.5) }, "+"),
          gm.el("button", { type: "button", title: "zoom out (−)", "aria-label": "zoom out", onclick: () => zoom.by(1 / 1.5) }, "−"),
          gm.el("button", { type: "button", title: "show all (0)", onclick: () => zoom.fit() }, "whole")),
    };
    return zoom;
  };
})();
