"use strict";
// Where each grain is drawn: interpolated and magnified motions, as they are or less the sample's own rigid motion.
(() => {
  const gm = (window.gm ??= {});
  const MIN_GRAINS = 3; // for a rigid motion of the sample; its rotation is left out below
  const DEGREE = Math.PI / 180;

  /** Quaternion [x, y, z, w] of a rotation vector in radians. */
  const ofVector = ([x, y, z]) => {
    const angle = Math.hypot(x, y, z);
    const s = angle > 1e-12 ? Math.sin(angle / 2) / angle : 0.5;
    return [s * x, s * y, s * z, Math.cos(angle / 2)];
  };

  /** Rotation vector, radians, of a quaternion; the short way round. */
  const toVector = ([x, y, z, w]) => {
    const sign = w < 0 ? -1 : 1, sine = Math.hypot(x, y, z);
    const factor = sine > 1e-12 ? (2 * Math.atan2(sine, sign * w) * sign) / sine : 2 * sign;
    return [factor * x, factor * y, factor * z];
  };

  const product = ([ax, ay, az, aw], [bx, by, bz, bw]) => [
    aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx,
    aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz,
  ];
  const inverse = ([x, y, z, w]) => [-x, -y, -z, w];
  const turned = (q, v) => product(product(q, [...v, 0]), inverse(q)).slice(0, 3);

  /** Rotation of the largest eigenvalue of Horn's matrix (J. Opt. Soc. Am. A 4, 1987), by shifted power iteration. */
  const horn = (s) => {
    const [xx, xy, xz, yx, yy, yz, zx, zy, zz] = s;
    const m = [ // for [w, x, y, z]
      [xx + yy + zz, yz - zy, zx - xz, xy - yx],
      [yz - zy, xx - yy - zz, xy + yx, zx + xz],
      [zx - xz, xy + yx, yy - xx - zz, yz + zy],
      [xy - yx, zx + xz, yz + zy, zz - xx - yy],
    ];
    const shift = Math.max(...m.map((row) => row.reduce((sum, v) => sum + Math.abs(v), 0))) || 1;
    let q = [1, 1e-3, 1e-3, 1e-3];
    for (let step = 0; step < 2000; step++) {
      const next = m.map((row, k) => row.reduce((sum, v, j) => sum + v * q[j], shift * q[k]));
      const length = Math.hypot(...next);
      const change = Math.hypot(...next.map((v, k) => v / length - q[k]));
      q = next.map((v) => v / length);
      if (change < 1e-12) break;
    }
    return [q[1], q[2], q[3], q[0]];
  };

  /** Rigid motion that fits the centres' motions best: { pivot, shift, turn (quaternion) }; grains without one left out. */
  const rigid = (centers, u, measured) => {
    const pivot = [0, 0, 0], shift = [0, 0, 0], s = new Array(9).fill(0);
    let count = 0;
    measured.forEach((known, i) => {
      if (!known) return;
      count++;
      for (let k = 0; k < 3; k++) { pivot[k] += centers[3 * i + k]; shift[k] += u[k][i]; }
    });
    if (!count) return { pivot, shift, turn: [0, 0, 0, 1] };
    for (let k = 0; k < 3; k++) { pivot[k] /= count; shift[k] /= count; }
    measured.forEach((known, i) => {
      if (!known) return;
      const a = [0, 1, 2].map((k) => centers[3 * i + k] - pivot[k]);
      const b = [0, 1, 2].map((k) => a[k] + u[k][i] - shift[k]);
      for (let j = 0; j < 3; j++) for (let k = 0; k < 3; k++) s[3 * j + k] += a[j] * b[k];
    });
    return { pivot, shift, turn: count >= MIN_GRAINS ? horn(s) : [0, 0, 0, 1] };
  };

  /**
   * Translations (3 a grain, mm) and rotation vectors (3 a grain, radians) to draw, from columns ux uy uz wx wy wz
   * (mm, degrees): as measured, or less the sample's rigid motion, which is that of the translations to use (`used`; all
   * unless given).  Grains without a measured motion follow the sample's; `known` says which have one.
   */
  const motions = (centers, columns, relative, used = null) => {
    const n = centers.length / 3, u = columns.slice(0, 3), w = columns.slice(3);
    const known = Array.from({ length: n }, (_, i) => u.every((c) => Number.isFinite(c[i])));
    const whole = rigid(centers, u, known.map((yes, i) => yes && (!used || Boolean(used[i])))), back = inverse(whole.turn), turnOfWhole = toVector(whole.turn);
    const shifts = new Float32Array(3 * n), turns = new Float32Array(3 * n);
    for (let i = 0; i < n; i++) {
      const arm = [0, 1, 2].map((k) => centers[3 * i + k] - whole.pivot[k]);
      let shift, turn;
      if (!known[i]) {
        shift = relative ? [0, 0, 0] : turned(whole.turn, arm).map((v, k) => v - arm[k] + whole.shift[k]);
        turn = relative ? [0, 0, 0] : turnOfWhole;
      } else {
        shift = u.map((c) => c[i]);
        turn = w.map((c) => (Number.isFinite(c[i]) ? c[i] * DEGREE : 0));
        if (relative) {
          const moved = arm.map((v, k) => v + shift[k] - whole.shift[k]);
          shift = turned(back, moved).map((v, k) => v - arm[k]);
          turn = toVector(product(back, ofVector(turn)));
        }
      }
      shifts.set(shift, 3 * i);
      turns.set(turn, 3 * i);
    }
    return { shifts, turns, known, whole };
  };

  gm.viewerMotion = { motions, rigid, ofVector, toVector, product, turned };
})();
