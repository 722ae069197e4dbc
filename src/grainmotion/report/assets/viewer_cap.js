"use strict";
// The flat face where a plane cuts grains, each in its colour: drawn on the plane, from a count of surfaces behind it.
(() => {
  const gm = (window.gm ??= {});
  const BASE = 40; // of a row's digits: BASE³ rows; sums of digits over as many layers of grains stay exact in 16 bits
  const REACH = 4; // of the face from its middle to either side, over the farthest distance that the camera sees

  // Behind the plane every grain has as many fronts as backs, but the one that the plane cuts at this pixel: one back
  // more.  So the sum over backs less that over fronts, of 1 and of the row's digits, tells whether and which.
  const COUNT = `
    in vec3 vWorld;
    flat in float vOwner;
    uniform vec4 plane; // its axis, and its place along it
    uniform float side; // 1 where the eye is below it and grains above it are shown, else −1
    out vec4 sum;
    void main() {
      if (side * (dot(vWorld, plane.xyz) - plane.w) < 0.0) discard;
      int row = int(vOwner + 0.5);
      sum = (gl_FrontFacing ? -1.0 : 1.0) * vec4(row % ${BASE}, (row / ${BASE}) % ${BASE}, row / ${BASE * BASE}, 1);
    }`;
  const VERTEX = `
    uniform vec3 corner, along, across;
    void main() {
      gl_Position = projectionMatrix * viewMatrix * vec4(corner + position.x * along + position.y * across, 1.0);
    }`;
  const ROW_AT = `
    int rowAt(ivec2 pixel) { // −1 beside all grains, −2 where two overlap
      vec4 sum = texelFetch(counts, pixel, 0);
      if (sum.a < 0.5) return -1;
      if (sum.a > 1.5) return -2;
      ivec3 digits = ivec3(round(sum.rgb));
      return digits.r + ${BASE} * (digits.g + ${BASE} * digits.b);
    }`;
  const FRAGMENT = `
    precision highp sampler2D;
    uniform sampler2D counts, grains;
    uniform vec3 accent;
    out vec4 colour;
    ${ROW_AT}
    void main() {
      ivec2 pixel = ivec2(gl_FragCoord.xy);
      int row = rowAt(pixel);
      if (row == -1) discard;
      int same = 0;
      for (int k = 0; k < 4; k++) same += int(rowAt(pixel + ivec2[](ivec2(1, 0), ivec2(-1, 0), ivec2(0, 1), ivec2(0, -1))[k]) == row);
      if (same == 0) discard; // a gap of a pixel between two triangles, no grain
      bool isInside = row >= 0 && same == 4;
      vec4 own = texelFetch(grains, gm_texel(max(row, 0)), 0);
      vec3 base = pow(own.rgb, vec3(2.2)) * (isInside ? 0.9 : 0.25); // a dark line around each grain
      colour = vec4(pow(mix(base, accent, isInside ? 0.4 * own.a : own.a), vec3(1.0 / 2.2)), 1.0);
    }`;

  /** The cut face of `grains`, an object of their scene; `texel` is GLSL that gives the place of a row's colour. */
  const create = (grains, vertexShader, texel) => {
    const { uniforms } = grains, target = new THREE.WebGLRenderTarget(1, 1, { type: THREE.HalfFloatType, depthBuffer: false });
    const own = { plane: { value: new Float32Array([0, 0, 1, 0]) }, side: { value: 1 } };
    const counting = new THREE.ShaderMaterial({
      glslVersion: THREE.GLSL3, vertexShader, fragmentShader: COUNT, uniforms: { ...uniforms, ...own }, side: THREE.DoubleSide,
      depthTest: false, depthWrite: false, blending: THREE.CustomBlending, blendSrc: THREE.OneFactor, blendDst: THREE.OneFactor,
    });
    const ends = Object.fromEntries(["corner", "along", "across"].map((name) => [name, { value: new THREE.Vector3() }]));
    const flat = new THREE.ShaderMaterial({
      glslVersion: THREE.GLSL3, vertexShader: VERTEX, fragmentShader: FRAGMENT.replace("gm_texel(max(row, 0))", texel("max(row, 0)")),
      uniforms: { counts: { value: target.texture }, grains: uniforms.grains, accent: uniforms.accent, ...ends }, side: THREE.DoubleSide,
    });
    const square = new THREE.BufferGeometry();
    square.setAttribute("position", new THREE.BufferAttribute(new Float32Array([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0]), 3));
    square.setIndex([0, 1, 2, 0, 2, 3]);
    const face = new THREE.Mesh(square, flat), countScene = new THREE.Scene();
    face.frustumCulled = false;
    face.visible = false;

    /** Find what the plane that the eye sees cuts, and place the face on it; before each picture. */
    const update = (renderer, camera) => {
      const axis = uniforms.cutAxis.value, { x: low, y: high } = uniforms.cutRange.value;
      const eye = camera.position.dot(axis), isCut = axis.lengthSq() > 0;
      const edge = eye < low ? low : high; // between the two planes the eye sees neither
      face.visible = isCut && (eye < low || eye > high) && renderer.extensions.has("EXT_color_buffer_float") && grains.count <= BASE ** 3;
      if (!face.visible) return;
      own.plane.value.set([axis.x, axis.y, axis.z, edge]);
      own.side.value = eye < low ? 1 : -1;
      const size = renderer.getDrawingBufferSize(new THREE.Vector2());
      if (target.width !== size.x || target.height !== size.y) target.setSize(size.x, size.y);
      const { mesh, group } = grains, shown = mesh.material;
      mesh.material = counting;
      countScene.add(mesh);
      renderer.setRenderTarget(target);
      renderer.clear();
      renderer.render(countScene, camera);
      renderer.setRenderTarget(null);
      mesh.material = shown;
      group.add(mesh);
      const { corner, along, across } = ends, far = REACH * camera.far;
      corner.value.copy(camera.position).addScaledVector(axis, edge - eye);
      along.value.set(axis.y, axis.z, axis.x).multiplyScalar(far);
      across.value.set(axis.z, axis.x, axis.y).multiplyScalar(far);
    };
    return { face, update };
  };

  gm.viewerCap = { create };
})();
