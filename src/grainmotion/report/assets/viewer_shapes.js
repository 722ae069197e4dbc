"use strict";
// Shapes of all grains as one list of triangles: vertices in steps from the centre of their grain, with its row.
(() => {
  const gm = (window.gm ??= {});
  const FULL = 32767; // a ball's radius in steps
  const BALL_LEVELS = [[2000, 2], [20000, 1], [Infinity, 0]]; // most balls drawn with so many subdivisions

  /** Vertices (unit length) and triangles of an icosahedron whose faces are divided `level` times. */
  const icosphere = (level) => {
    const g = (1 + Math.sqrt(5)) / 2;
    let points = [[-1, g, 0], [1, g, 0], [-1, -g, 0], [1, -g, 0], [0, -1, g], [0, 1, g], [0, -1, -g], [0, 1, -g],
      [g, 0, -1], [g, 0, 1], [-g, 0, -1], [-g, 0, 1]];
    let faces = [[0, 11, 5], [0, 5, 1], [0, 1, 7], [0, 7, 10], [0, 10, 11], [1, 5, 9], [5, 11, 4], [11, 10, 2],
      [10, 7, 6], [7, 1, 8], [3, 9, 4], [3, 4, 2], [3, 2, 6], [3, 6, 8], [3, 8, 9], [4, 9, 5], [2, 4, 11], [6, 2, 10],
      [8, 6, 7], [9, 8, 1]];
    for (let step = 0; step < level; step++) {
      const middles = new Map();
      const middle = (a, b) => {
        const key = a < b ? `${a} ${b}` : `${b} ${a}`;
        if (!middles.has(key)) middles.set(key, points.push(points[a].map((v, k) => v + points[b][k])) - 1);
        return middles.get(key);
      };
      faces = faces.flatMap(([a, b, c]) => {
        const [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
        return [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]];
      });
    }
    points = points.map((p) => p.map((v) => v / Math.hypot(...p)));
    return { points, faces };
  };

  /** Undo the differences of report/surfaces.py: vertices and triangles of grains or bodies, one after another. */
  const unpacked = async (surfaces) => {
    const names = ["vertices", "triangles", "scales", "vertex_counts", "triangle_counts"];
    const [steps, codes, scales, vertexCounts, triangleCounts] =
      await Promise.all(names.map((name) => gm.decode(surfaces[name])));
    const vertices = Int16Array.from(steps), triangles = new Uint16Array(codes.length);
    let v = 0, t = 0;
    vertexCounts.forEach((count, row) => {
      for (let i = v + 3; i < v + 3 * count; i++) vertices[i] += vertices[i - 3];
      v += 3 * count;
      let next = 0;
      for (const end = t + 3 * triangleCounts[row]; t < end; t++) {
        triangles[t] = next - codes[t];
        if (codes[t] === 0) next++;
      }
    });
    return { vertices, triangles, scales, vertexCounts, triangleCounts };
  };

  /** Radius of each grain without a surface: half its diameter, else that of its typical neighbours. */
  const ballRadii = (centers, diameters) => {
    const n = centers.length / 3;
    const known = diameters ? gm.median(diameters) / 2 : NaN;
    const sizes = [0, 1, 2].map((k) => {
      let low = Infinity, high = -Infinity;
      for (let i = k; i < 3 * n; i += 3) { low = Math.min(low, centers[i]); high = Math.max(high, centers[i]); }
      return Math.max(high - low, 0);
    });
    const spread = Math.max(...sizes) || 1;
    const usual = known > 0 ? known : 0.45 * Math.cbrt(sizes.reduce((v, s) => v * Math.max(s, 0.1 * spread), 1) / n);
    return Float32Array.from({ length: n }, (_, i) => (diameters?.[i] > 0 ? diameters[i] / 2 : usual));
  };

  const smoothNormals = (positions, index, count) => {
    const sums = new Float32Array(3 * count), normals = new Int8Array(4 * count);
    for (let t = 0; t < index.length; t += 3) {
      const [a, b, c] = [index[t], index[t + 1], index[t + 2]];
      const [ax, ay, az] = [positions[4 * a], positions[4 * a + 1], positions[4 * a + 2]];
      const ux = positions[4 * b] - ax, uy = positions[4 * b + 1] - ay, uz = positions[4 * b + 2] - az;
      const vx = positions[4 * c] - ax, vy = positions[4 * c + 1] - ay, vz = positions[4 * c + 2] - az;
      const nx = uy * vz - uz * vy, ny = uz * vx - ux * vz, nz = ux * vy - uy * vx;
      for (const k of [a, b, c]) { sums[3 * k] += nx; sums[3 * k + 1] += ny; sums[3 * k + 2] += nz; }
    }
    for (let i = 0; i < count; i++) {
      const length = Math.hypot(sums[3 * i], sums[3 * i + 1], sums[3 * i + 2]) || 1;
      for (let k = 0; k < 3; k++) normals[4 * i + k] = Math.round(127 * sums[3 * i + k] / length);
    }
    return normals;
  };

  /**
   * Promise of { positions (4 a vertex), normals (4 a vertex), owners, index, scales (mm a step), radii (mm),
   * starts (first corner of each grain in index, and the end) }; balls or ellipsoids where there are no meshes.
   */
  const load = (data) => {
    if (!loaded.has(data)) loaded.set(data, made(data));
    return loaded.get(data);
  };

  const loaded = new WeakMap();
  const made = async (data) => {
    const centers = await gm.decode(data.grains.centers);
    const diameters = data.grains.diameters ? await gm.decode(data.grains.diameters) : null;
    const n = centers.length / 3, kind = data.surfaces?.kind;
    const meshes = kind === "meshes" ? await unpacked(data.surfaces) : null;
    const matrices = kind === "ellipsoids" ? await gm.decode(data.surfaces.matrices) : null;
    const own = (row) => meshes?.vertexCounts[row] ?? 0;
    const balls = Array.from({ length: n }, (_, row) => row).filter((row) => !own(row)).length;
    const ball = icosphere(BALL_LEVELS.find(([most]) => balls <= most)[1]);
    let vertexTotal = 0, cornerTotal = 0;
    for (let row = 0; row < n; row++) {
      vertexTotal += own(row) || ball.points.length;
      cornerTotal += 3 * (own(row) ? meshes.triangleCounts[row] : ball.faces.length);
    }
    const positions = new Int16Array(4 * vertexTotal), owners = new Float32Array(vertexTotal);
    const index = new Uint32Array(cornerTotal), starts = new Uint32Array(n + 1);
    const scales = new Float32Array(n), radii = ballRadii(centers, diameters);
    let first = 0, corner = 0, v = 0, t = 0; // in the result; in the meshes
    for (let row = 0; row < n; row++) {
      starts[row] = corner;
      const count = own(row) || ball.points.length;
      if (own(row)) {
        let far = 0;
        for (let i = 0; i < count; i++, v += 3) {
          for (let k = 0; k < 3; k++) positions[4 * (first + i) + k] = meshes.vertices[v + k];
          far = Math.max(far, Math.hypot(meshes.vertices[v], meshes.vertices[v + 1], meshes.vertices[v + 2]));
        }
        for (const end = t + 3 * meshes.triangleCounts[row]; t < end; t++) index[corner++] = first + meshes.triangles[t];
        scales[row] = meshes.scales[row];
        radii[row] = far * scales[row];
      } else {
        const m = matrices?.subarray(9 * row, 9 * row + 9), fits = m && Number.isFinite(m[0]);
        const size = fits ? Math.max(...[0, 3, 6].map((k) => Math.hypot(m[k], m[k + 1], m[k + 2]))) : radii[row];
        ball.points.forEach((p, i) => {
          for (let k = 0; k < 3; k++) {
            const place = fits ? (m[3 * k] * p[0] + m[3 * k + 1] * p[1] + m[3 * k + 2] * p[2]) / size : p[k];
            positions[4 * (first + i) + k] = Math.round(FULL * place);
          }
        });
        for (const face of ball.faces) for (const p of face) index[corner++] = first + p;
        scales[row] = size / FULL;
        radii[row] = size;
      }
      owners.fill(row, first, first + count);
      first += count;
    }
    starts[n] = corner;
    return { positions, normals: smoothNormals(positions, index, vertexTotal), owners, index, scales, radii, starts };
  };

  gm.viewerShapes = { load, unpacked };
})();
