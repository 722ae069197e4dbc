"use strict";
// Footprints of grains on radiographs: the outline of a grain's surface at its moved place, projected.
(() => {
  const gm = (globalThis.gm ??= {});
  const MOTION = ["ux", "uy", "uz", "wx", "wy", "wz"]; // mm and degrees
  const BALL_POINTS = 240;

  /** Points evenly spread over the unit ball's surface (a spiral), one after another. */
  const ball = (() => {
    const points = new Float32Array(3 * BALL_POINTS);
    for (let k = 0; k < BALL_POINTS; k++) {
      const z = 1 - (2 * k + 1) / BALL_POINTS, r = Math.sqrt(1 - z * z), angle = k * 2.399963;
      points.set([r * Math.cos(angle), r * Math.sin(angle), z], 3 * k);
    }
    return points;
  })();

  /** Points of the surfaces of all grains relative to their centres, mm: a function of the row, null where unknown. */
  async function surfacePoints(data) {
    const { surfaces, grains } = data;
    const diameters = grains.diameters && (await gm.decode(grains.diameters));
    const ofDiameter = (row) => (diameters?.[row] > 0 ? ball.map((x) => (x * diameters[row]) / 2) : null);
    if (surfaces?.kind === "ellipsoids") {
      const matrices = await gm.decode(surfaces.matrices);
      return (row) => (Number.isFinite(matrices[9 * row]) ? stretched(matrices.subarray(9 * row, 9 * row + 9)) : ofDiameter(row));
    }
    if (surfaces?.kind !== "meshes") return ofDiameter;
    const { positions, owners, scales } = await gm.viewerShapes.load(data);
    const first = new Uint32Array(grains.labels.length + 1).fill(owners.length);
    for (let k = owners.length - 1; k >= 0; k--) first[owners[k]] = k;
    for (let row = grains.labels.length - 1; row >= 0; row--) first[row] = Math.min(first[row], first[row + 1]);
    return (row) => {
      const points = new Float32Array(3 * (first[row + 1] - first[row]));
      for (let k = first[row], at = 0; k < first[row + 1]; k++) {
        for (let axis = 0; axis < 3; axis++) points[at++] = positions[4 * k + axis] * scales[row];
      }
      return points;
    };
  }

  /** The unit ball's points under a matrix of three rows. */
  function stretched(m) {
    const points = new Float32Array(ball.length);
    for (let k = 0; k < ball.length; k += 3) {
      for (let row = 0; row < 3; row++) {
        points[k + row] = m[3 * row] * ball[k] + m[3 * row + 1] * ball[k + 1] + m[3 * row + 2] * ball[k + 2];
      }
    }
    return points;
  }

  /**
   * Footprints in a state: an object with `outline(row, view)`, the convex outline [[column, row], ...] as shown, empty
   * where the grain has no place there; `center(row, view)`; and `at(point, view)`, rows of the grains whose footprint
   * holds a point, the one whose centre is nearest to the point's ray first.
   */
  async function of(app, state) {
    const [centers, points, ...motion] = await Promise.all([
      gm.decode(app.data.grains.centers), points_(app), ...MOTION.map((name) => app.column(state, name)),
    ]);
    const places = new Map();

    /** The rotation and the centre of a grain in this state; null if it has none. */
    const place = (row) => {
      if (!places.has(row)) {
        const m = motion.map((column) => column[row]);
        const center = [0, 1, 2].map((k) => centers[3 * row + k] + m[k]);
        const turn = gm.projection.rotation(m.slice(3).map((w) => ((Number.isFinite(w) ? w : 0) * Math.PI) / 180));
        places.set(row, center.every(Number.isFinite) ? { center, turn } : null);
      }
      return places.get(row);
    };

    const center = (row, view) => {
      const to = gm.projection.camera(view), at = place(row);
      return to && at ? to(at.center) : null;
    };

    const outline = (row, view) => {
      const to = gm.projection.camera(view), at = place(row), surface = at && points(row);
      if (!to || !surface) return [];
      const { center: c, turn: r } = at, shown = [];
      for (let k = 0; k < surface.length; k += 3) {
        const x = surface[k], y = surface[k + 1], z = surface[k + 2];
        shown.push(to([
          c[0] + r[0] * x + r[1] * y + r[2] * z,
          c[1] + r[3] * x + r[4] * y + r[5] * z,
          c[2] + r[6] * x + r[7] * y + r[8] * z,
        ]));
      }
      return gm.projection.hull(shown);
    };

    const at = (point, view) => {
      const near = [];
      for (let row = 0; row < app.data.grains.labels.length; row++) {
        const middle = center(row, view);
        if (!middle || !Number.isFinite(middle[0])) continue;
        const distance = Math.hypot(middle[0] - point[0], middle[1] - point[1]);
        if (distance <= reach(row, view)) near.push([distance, row]);
      }
      near.sort((a, b) => a[0] - b[0]);
      return near.map(([, row]) => row).filter((row) => gm.projection.holds(outline(row, view), point));
    };

    /** More than the footprint reaches from its centre, pixels. */
    const reach = (row, view) => {
      const surface = points(row), to = gm.projection.camera(view);
      if (!surface) return 0;
      let far = 0;
      for (let k = 0; k < surface.length; k += 3) far = Math.max(far, Math.hypot(surface[k], surface[k + 1], surface[k + 2]));
      const { center: c } = place(row), middle = to(c);
      const steps = [[far, 0, 0], [0, far, 0], [0, 0, far]].map((step) => to(c.map((x, k) => x + step[k])));
      return 1.1 * Math.hypot(...steps.map((step) => Math.hypot(step[0] - middle[0], step[1] - middle[1])));
    };

    return { outline, center, at };
  }

  const surfaces = new WeakMap();
  const points_ = (app) => {
    if (!surfaces.has(app)) surfaces.set(app, surfacePoints(app.data));
    return surfaces.get(app);
  };

  const states = new Map();
  gm.footprints = {
    /** Promise of the footprints in a state, made once. */
    of(app, state) {
      if (!states.has(state)) states.set(state, of(app, state));
      return states.get(state);
    },

    /** Draw an outline on a canvas; `place` takes a point of the radiograph to the canvas. */
    draw(context, outline, place, colour) {
      if (outline.length < 2) return;
      context.beginPath();
      for (const point of outline) context.lineTo(...place(point));
      context.closePath();
      context.lineJoin = "round";
      for (const [width, style] of [[4, "rgb(0 0 0 / 0.65)"], [2, colour]]) {
        context.lineWidth = width;
        context.strokeStyle = style;
        context.stroke();
      }
    },
  };
})();
