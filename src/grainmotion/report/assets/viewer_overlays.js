"use strict";
// What is drawn beside the grains: arrows, weak directions of the chosen grain, and the box of the field.
(() => {
  const gm = (window.gm ??= {});
  const LONGEST = 0.16; // of the sample's size, of the longest arrow
  const WEAK_RATIO = 1.5; // largest over smallest sd from which a direction is drawn
  const CORNERS = [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]];
  const EDGES = [0, 1, 1, 2, 2, 3, 3, 0, 4, 5, 5, 6, 6, 7, 7, 4, 0, 4, 1, 5, 2, 6, 3, 7];

  const VERTEX = `
    in vec3 start, along, tint;
    uniform float thickness;
    out vec3 vNormal, vTint, vWorld;
    void main() {
      float length_ = length(along);
      vec3 z = length_ > 0.0 ? along / length_ : vec3(0.0, 0.0, 1.0);
      vec3 x = normalize(cross(abs(z.z) < 0.9 ? vec3(0.0, 0.0, 1.0) : vec3(1.0, 0.0, 0.0), z));
      mat3 frame = mat3(x, cross(z, x), z);
      float wide = min(thickness, 0.35 * length_); // short arrows are slender too
      bool isHead = position.z > 1.5; // the head: z from 2 (its base) to 3 (its tip)
      float head = 4.5 * wide;
      float height = isHead ? length_ - head * (3.0 - position.z) : position.z * max(length_ - head, 0.0);
      vWorld = start + frame * vec3(position.xy * wide, height);
      vNormal = mat3(viewMatrix) * (frame * normal);
      vTint = tint;
      gl_Position = length_ > 0.0 ? projectionMatrix * viewMatrix * vec4(vWorld, 1.0) : vec4(0.0, 0.0, 2.0, 1.0);
    }`;
  const FRAGMENT = `
    in vec3 vNormal, vTint, vWorld;
    uniform vec3 cutAxis;
    uniform vec2 cutRange;
    out vec4 colour;
    void main() {
      float s = dot(vWorld, cutAxis);
      if (s < cutRange.x || s > cutRange.y) discard;
      vec3 n = normalize(vNormal);
      float light = 0.55 + 0.5 * max(dot(n, normalize(vec3(-0.4, 0.6, 0.8))), 0.0);
      colour = vec4(pow(pow(vTint, vec3(2.2)) * light, vec3(1.0 / 2.2)), 1.0);
    }`;

  /** A shaft of radius 1 (z from 0 to 1) and a head (z from 2 to 3), for the program above. */
  const arrowGeometry = () => {
    const sides = 8, points = [], normals = [], index = [];
    const ring = (radius, z, slope) => {
      const first = points.length / 3;
      for (let k = 0; k < sides; k++) {
        const a = (2 * Math.PI * k) / sides, c = Math.cos(a), s = Math.sin(a), l = Math.hypot(1, slope);
        points.push(radius * c, radius * s, z);
        normals.push(c / l, s / l, slope / l);
      }
      return first;
    };
    const join = (a, b) => {
      for (let k = 0; k < sides; k++) {
        const next = (k + 1) % sides;
        index.push(a + k, a + next, b + k, a + next, b + next, b + k);
      }
    };
    join(ring(1, 0, 0), ring(1, 1, 0));
    join(ring(0, 2, -9), ring(2.4, 2, -9));
    join(ring(2.4, 2, 0.5), ring(0, 3, 0.5));
    const geometry = new THREE.InstancedBufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
    geometry.setAttribute("normal", new THREE.BufferAttribute(new Float32Array(normals), 3));
    geometry.setIndex(index);
    return geometry;
  };

  const arrowMesh = (cut, options) => {
    const uniforms = { thickness: { value: 1 }, cutAxis: cut.cutAxis, cutRange: cut.cutRange };
    const material = new THREE.ShaderMaterial({
      glslVersion: THREE.GLSL3, vertexShader: VERTEX, fragmentShader: FRAGMENT, uniforms, ...options,
    });
    const mesh = new THREE.Mesh(arrowGeometry(), material);
    mesh.frustumCulled = false;
    mesh.visible = false;
    return mesh;
  };

  /** Arrows from starts along vectors (3 numbers each) in colours (0 to 255). */
  const setArrows = (mesh, starts, vectors, colours, thickness) => {
    mesh.geometry.dispose();
    mesh.geometry = arrowGeometry();
    for (const [name, values] of [["start", starts], ["along", vectors], ["tint", Float32Array.from(colours, (c) => c / 255)]]) {
      mesh.geometry.setAttribute(name, new THREE.InstancedBufferAttribute(Float32Array.from(values), 3));
    }
    mesh.geometry.instanceCount = starts.length / 3;
    mesh.material.uniforms.thickness.value = thickness;
    mesh.visible = starts.length > 0;
  };

  /** Largest of 1, 2, 5, 10, ... by which the longest of vectors stays within a length. */
  const roundFactor = (longest, wanted) => {
    if (!(longest > 0)) return 1;
    const ideal = wanted / longest, power = 10 ** Math.floor(Math.log10(ideal));
    return [5, 2, 1].find((digit) => digit * power <= ideal * (1 + 1e-9)) * power;
  };

  /** The twelve edges of a box as a list of points. */
  const boxEdges = (low, high) => {
    const corner = (bits) => bits.map((bit, k) => (bit ? high[k] : low[k]));
    return EDGES.flatMap((k) => corner(CORNERS[k]));
  };

  const lines = (points, options) => {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(Float32Array.from(points), 3));
    return new THREE.LineSegments(geometry, new THREE.LineBasicMaterial({ transparent: true, ...options }));
  };

  /** A circle about an axis, as pairs of points. */
  const circle = (center, axis, radius) => {
    const [x, y, z] = axis, helper = Math.abs(z) < 0.9 ? [0, 0, 1] : [1, 0, 0];
    const a = new THREE.Vector3(...helper).cross(new THREE.Vector3(x, y, z)).normalize();
    const b = new THREE.Vector3(x, y, z).cross(a), points = [], steps = 48;
    for (let k = 0; k <= steps; k++) {
      const angle = (2 * Math.PI * k) / steps, c = radius * Math.cos(angle), s = radius * Math.sin(angle);
      const point = center.map((value, i) => value + c * a.getComponent(i) + s * b.getComponent(i));
      points.push(...point);
      if (k > 0 && k < steps) points.push(...point);
    }
    return points;
  };

  /** The overlays about grains; `box` has the corners of the field, if it is known, `size` is that of the sample (mm). */
  const create = (grains, box, size) => {
    const arrows = arrowMesh(grains.uniforms, {}), group = new THREE.Group();
    const weak = arrowMesh({ cutAxis: { value: new THREE.Vector3() }, cutRange: { value: new THREE.Vector2(-1, 1) } },
      { depthTest: false });
    weak.renderOrder = 3;
    const field = box ? lines(boxEdges(...box), { opacity: 0.4 }) : null;
    group.add(...[arrows, weak, field].filter(Boolean));
    let ring = null;

    /** Arrows of vectors (3 a grain) at rows; returns the factor by which they are longer than the vectors. */
    const showArrows = (vectors, rows, colours) => {
      if (!vectors) { arrows.visible = false; return 1; }
      let longest = 0;
      for (const row of rows) longest = Math.max(longest, Math.hypot(...vectors.subarray(3 * row, 3 * row + 3)));
      const factor = roundFactor(longest, LONGEST * size);
      const triple = (list, scale = 1) => rows.flatMap((row) => [0, 1, 2].map((k) => scale * list[3 * row + k]));
      setArrows(arrows, triple(grains.places), triple(vectors, factor), triple(colours), 0.0035 * size);
      return factor;
    };

    /** Weak directions of a grain: of its translation a double arrow, of its rotation an axis with a circle; false if none. */
    const showWeak = (row, parts, tint) => {
      if (ring) { group.remove(ring); ring.geometry.dispose(); ring = null; }
      const starts = [], vectors = [], center = [...grains.places.subarray(3 * row, 3 * row + 3)];
      const radius = grains.radii[row], circles = [];
      for (const [part, { direction, sd, least }] of Object.entries(parts ?? {})) {
        if (!(sd[row] / least[row] > WEAK_RATIO)) continue;
        const axis = [...direction.subarray(3 * row, 3 * row + 3)], length = Math.hypot(...axis);
        if (!(length > 0)) continue;
        const unit = axis.map((value) => value / length);
        if (part === "rotation") circles.push(...circle(center.map((c, k) => c + 1.25 * radius * unit[k]), unit, 0.4 * radius));
        for (const sign of part === "rotation" ? [1] : [1, -1]) {
          starts.push(...center);
          vectors.push(...unit.map((value) => sign * (part === "rotation" ? 1.7 : 2.1) * radius * value));
        }
      }
      setArrows(weak, starts, vectors, starts.map((_, i) => tint[i % 3]), 0.03 * radius);
      if (!circles.length) return starts.length > 0;
      ring = lines(circles, { depthTest: false, color: new THREE.Color(...tint.map((c) => (c / 255) ** 2.2)) });
      ring.renderOrder = 3;
      group.add(ring);
      return true;
    };

    const setColour = (colour) => field?.material.color.set(colour);
    return { group, showArrows, showWeak, setColour };
  };

  gm.viewerOverlays = { create };
})();
