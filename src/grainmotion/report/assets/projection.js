"use strict";
// Where points of the sample appear on a radiograph, as model/panel_projection.py, and outlines of sets of points.
(() => {
  const gm = (globalThis.gm ??= {});
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const cross = (a, b) => [
    a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0],
  ];

  /**
   * The projection of a view: a function of a point [x, y, z] (mm) to [column, row], with rows as they are shown (z up,
   * row 0 uppermost); NaN for a point behind the source.  Null if the report does not know the view's geometry.
   */
  function camera(view) {
    if (!cameras.has(view)) cameras.set(view, view.geometry && cameraOf(view));
    return cameras.get(view);
  }

  const cameras = new WeakMap();
  const cameraOf = (view) => {
    const { source, detector, u, v, beam } = view.geometry;
    const normal = cross(u, v), uu = dot(u, u), uv = dot(u, v), vv = dot(v, v), det = uu * vv - uv * uv;
    const toColumn = u.map((_, k) => (vv * u[k] - uv * v[k]) / det);
    const toRow = u.map((_, k) => (uu * v[k] - uv * u[k]) / det);
    const middleColumn = (view.columns - 1) / 2, middleRow = (view.rows - 1) / 2;
    const upwards = view.first_row === "bottom" ? -1 : 1;
    return (point) => {
      const start = beam === "cone" ? source : point;
      const ray = beam === "cone" ? minus(point, source) : source;
      let t = dot(minus(detector, start), normal) / dot(ray, normal);
      if (beam === "cone" && !(t > 0)) t = NaN;
      const offset = start.map((s, k) => s + t * ray[k] - detector[k]);
      return [middleColumn + dot(offset, toColumn), middleRow + upwards * dot(offset, toRow)];
    };
  };

  /** Row of the radiograph's own numbering that is shown as this row (0 uppermost), and the other way round. */
  const ownRow = (view, shown) => (view.first_row === "bottom" ? view.rows - 1 - shown : shown);

  /** Rotation matrix, by rows, of a rotation vector [wx, wy, wz] in radians (Rodrigues). */
  function rotation(w) {
    const angle = Math.hypot(...w);
    const a = angle > 1e-12 ? Math.sin(angle) / angle : 1;
    const b = angle > 1e-12 ? (1 - Math.cos(angle)) / (angle * angle) : 0.5;
    const [x, y, z] = w;
    return [
      1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y,
      b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x,
      b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y),
    ];
  }

  /** Convex hull of points [x, y], counter-clockwise where y points up (Andrew's monotone chain). */
  function hull(points) {
    const sorted = points.filter(([x, y]) => Number.isFinite(x) && Number.isFinite(y));
    sorted.sort((a, b) => a[0] - b[0] || a[1] - b[1]);
    if (sorted.length < 3) return sorted;
    const turn = (o, a, b) => (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
    const half = (ordered) => {
      const chain = [];
      for (const point of ordered) {
        while (chain.length > 1 && turn(chain.at(-2), chain.at(-1), point) <= 0) chain.pop();
        chain.push(point);
      }
      return chain.slice(0, -1);
    };
    return [...half(sorted), ...half(sorted.reverse())];
  }

  /** Whether a convex outline, in either sense of rotation, holds a point. */
  function holds(outline, [x, y]) {
    if (outline.length < 3) return false;
    let side = 0;
    for (let k = 0; k < outline.length; k++) {
      const [ax, ay] = outline[k], [bx, by] = outline[(k + 1) % outline.length];
      const now = Math.sign((bx - ax) * (y - ay) - (by - ay) * (x - ax));
      if (now !== 0 && side !== 0 && now !== side) return false;
      if (now !== 0) side = now;
    }
    return true;
  }

  /** Lowest and highest x and y of an outline: { left, right, top, bottom }. */
  function box(outline) {
    const xs = outline.map((p) => p[0]), ys = outline.map((p) => p[1]);
    return { left: Math.min(...xs), right: Math.max(...xs), top: Math.min(...ys), bottom: Math.max(...ys) };
  }

  gm.projection = { camera, ownRow, rotation, hull, holds, box };
})();
