"use strict";
// All grains in one draw call: pose and colour of each grain lie in a texture, which the vertex program looks up.
(() => {
  const gm = (window.gm ??= {});
  const GRAINS_A_ROW = 256, TEXELS = 3; // of a grain: place and scale; rotation; colour and mark
  const MANY_GRAINS = 1500; // from which a slow machine draws even fewer triangles a grain
  const SELECTED = 1, HOVERED = 0.5;

  /** GLSL: the place of a grain's texel in the texture. */
  const texel = (row, k) => `ivec2(${TEXELS} * (${row} % ${GRAINS_A_ROW}) + ${k}, ${row} / ${GRAINS_A_ROW})`;
  const VERTEX = `
    precision highp sampler2D;
    uniform sampler2D grains;
    uniform float size;
    in float owner;
    out vec3 vPlace, vNormal, vWorld;
    flat out vec4 vColour;
    flat out float vOwner;
    vec3 turn(vec4 q, vec3 v) { return v + 2.0 * cross(q.xyz, cross(q.xyz, v) + q.w * v); }
    void main() {
      int row = int(owner + 0.5);
      vec4 place = texelFetch(grains, ${texel("row", 0)}, 0);
      vec4 rotation = texelFetch(grains, ${texel("row", 1)}, 0);
      vColour = texelFetch(grains, ${texel("row", 2)}, 0);
      vOwner = owner;
      vWorld = place.xyz + turn(rotation, position * place.w * size);
      vec4 seen = viewMatrix * vec4(vWorld, 1.0);
      vPlace = seen.xyz;
      vNormal = mat3(viewMatrix) * turn(rotation, normal);
      gl_Position = place.w > 0.0 ? projectionMatrix * seen : vec4(0.0, 0.0, 2.0, 1.0); // hidden: beyond the far plane
    }`;
  const CUT = `
    uniform vec3 cutAxis;
    uniform vec2 cutRange;
    void cut() { float s = dot(vWorld, cutAxis); if (s < cutRange.x || s > cutRange.y) discard; }`;
  const FRAGMENT = `
    in vec3 vPlace, vNormal, vWorld;
    flat in vec4 vColour;
    uniform vec3 accent;
    uniform vec3 up;
    out vec4 colour;
    ${CUT}
    void main() {
      cut();
      vec3 base = pow(vColour.rgb, vec3(2.2));
      vec3 toEye = normalize(-vPlace);
      vec3 n = normalize(vNormal);
      float facing = clamp(dot(n, toEye), 0.0, 1.0);
      float sky = 0.5 + 0.5 * dot(n, up);
      float sun = max(dot(n, normalize(vec3(-0.45, 0.6, 0.75))), 0.0);
      vec3 light = mix(vec3(0.34, 0.33, 0.36), vec3(0.58, 0.6, 0.62), sky) + sun * vec3(0.52, 0.5, 0.47);
      vec3 lit = base * light * mix(0.5, 1.0, smoothstep(0.0, 0.55, facing)); // darker edges part touching grains
      float shine = pow(max(dot(n, normalize(vec3(-0.45, 0.6, 0.75) + toEye)), 0.0), 36.0);
      lit += 0.06 * shine;
      if (!gl_FrontFacing) lit = base * 0.6; // the inside, where the grain is cut
      if (vColour.a > 0.0) lit = mix(lit, accent, vColour.a * (0.1 + 0.9 * smoothstep(0.35, 1.0, 1.0 - facing)));
      colour = vec4(pow(lit, vec3(1.0 / 2.2)), 1.0);
    }`;
  const ID_FRAGMENT = `
    in vec3 vWorld;
    flat in float vOwner;
    out vec4 colour;
    ${CUT}
    void main() {
      cut();
      int id = int(vOwner + 1.5);
      colour = vec4(float(id & 255), float((id >> 8) & 255), float((id >> 16) & 255), 255.0) / 255.0;
    }`;
  const GHOST_FRAGMENT = `
    in vec3 vPlace, vNormal;
    uniform vec3 accent;
    out vec4 colour;
    void main() {
      float facing = abs(dot(normalize(vNormal), normalize(-vPlace)));
      colour = vec4(pow(accent, vec3(1.0 / 2.2)), 0.1 + 0.7 * pow(1.0 - facing, 2.5));
    }`;

  const geometryOf = (shapes) => {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(shapes.positions, 4));
    geometry.setAttribute("normal", new THREE.BufferAttribute(shapes.normals, 4, true));
    geometry.setAttribute("owner", new THREE.BufferAttribute(shapes.owners, 1));
    geometry.setIndex(new THREE.BufferAttribute(shapes.index, 1));
    return geometry;
  };

  /**
   * Corners of few triangles a grain on the same vertices, for slow machines while the view turns: vertices are merged
   * by their direction from the centre, 14 or 26 of them (faces, corners and edges of a cube).
   */
  const coarseIndex = ({ positions, owners, index, scales }) => {
    const finest = scales.length <= MANY_GRAINS, first = new Map(), merged = new Uint32Array(owners.length);
    for (let i = 0; i < owners.length; i++) {
      const p = [positions[4 * i], positions[4 * i + 1], positions[4 * i + 2]];
      const top = Math.max(...p.map(Math.abs)) || 1, length = Math.hypot(...p) || 1;
      const flat = finest ? 0.5 : top > 0.8 * length ? 0.999 : 0; // share of the largest component that counts as none
      const bin = p.reduce((sum, v) => 3 * sum + (v > flat * top ? 2 : v < -flat * top ? 0 : 1), 27 * owners[i]);
      if (!first.has(bin)) first.set(bin, i);
      merged[i] = first.get(bin);
    }
    const kept = [];
    for (let t = 0; t < index.length; t += 3) {
      const [a, b, c] = [merged[index[t]], merged[index[t + 1]], merged[index[t + 2]]];
      if (a !== b && b !== c && c !== a) kept.push(a, b, c);
    }
    return Uint32Array.from(kept);
  };

  /** The grains as an object of the scene: { group, setPoses, setColours, mark, cut, pick, ... }. */
  const create = (shapes, centers) => {
    const n = shapes.scales.length, width = TEXELS * GRAINS_A_ROW, height = Math.max(1, Math.ceil(n / GRAINS_A_ROW));
    const texels = new Float32Array(4 * width * height);
    const texture = new THREE.DataTexture(texels, width, height, THREE.RGBAFormat, THREE.FloatType);
    const hidden = new Uint8Array(n), places = Float32Array.from(centers);
    const uniforms = {
      grains: { value: texture }, size: { value: 1 }, accent: { value: new THREE.Vector3() },
      up: { value: new THREE.Vector3(0, 1, 0) }, cutAxis: { value: new THREE.Vector3() },
      cutRange: { value: new THREE.Vector2(-1, 1) },
    };
    const material = (fragmentShader, options) =>
      new THREE.ShaderMaterial({ glslVersion: THREE.GLSL3, vertexShader: VERTEX, fragmentShader, uniforms, ...options });
    const drawn = material(FRAGMENT), ids = material(ID_FRAGMENT, {});
    const ghostly = material(GHOST_FRAGMENT, { transparent: true, depthTest: false, depthWrite: false });
    const all = geometryOf(shapes), mesh = new THREE.Mesh(all, drawn), ghost = new THREE.Mesh(new THREE.BufferGeometry(), ghostly);
    for (const [name, attribute] of Object.entries(mesh.geometry.attributes)) ghost.geometry.setAttribute(name, attribute);
    ghost.geometry.setIndex(mesh.geometry.index);
    mesh.frustumCulled = ghost.frustumCulled = false;
    ghost.renderOrder = 2;
    ghost.visible = false;
    const group = new THREE.Group();
    group.add(mesh, ghost);
    const target = new THREE.WebGLRenderTarget(1, 1), pixel = new Uint8Array(4), pickScene = new THREE.Scene();
    let few = null;
    const at = (row) => 4 * (TEXELS * (row % GRAINS_A_ROW) + width * Math.floor(row / GRAINS_A_ROW));

    const setPoses = ({ shifts, turns }, factor) => {
      for (let row = 0; row < n; row++) {
        const texel = at(row);
        for (let k = 0; k < 3; k++) {
          places[3 * row + k] = centers[3 * row + k] + factor * shifts[3 * row + k];
          texels[texel + k] = places[3 * row + k];
        }
        const visible = !hidden[row] && Number.isFinite(places[3 * row]);
        texels[texel + 3] = visible ? shapes.scales[row] : 0;
        texels.set(gm.viewerMotion.ofVector([0, 1, 2].map((k) => factor * turns[3 * row + k])), texel + 4);
      }
      texture.needsUpdate = true;
    };
    const setColours = (colours) => {
      for (let row = 0; row < n; row++) {
        for (let k = 0; k < 3; k++) texels[at(row) + 8 + k] = colours[3 * row + k] / 255;
      }
      texture.needsUpdate = true;
    };
    const mark = (selected, hovered) => {
      for (let row = 0; row < n; row++) texels[at(row) + 11] = row === selected ? SELECTED : row === hovered ? HOVERED : 0;
      ghost.visible = selected >= 0 && !hidden[selected];
      if (ghost.visible) ghost.geometry.setDrawRange(shapes.starts[selected], shapes.starts[selected + 1] - shapes.starts[selected]);
      texture.needsUpdate = true;
    };
    /** Show only what lies between low and high along an axis; all of it without one. */
    const cut = (axis, low, high) => {
      uniforms.cutAxis.value.set(...(axis ?? [0, 0, 0]));
      uniforms.cutRange.value.set(axis ? low : -1, axis ? high : 1);
      const side = axis ? THREE.DoubleSide : THREE.FrontSide;
      if (drawn.side === side) return;
      for (const one of [drawn, ids]) {
        one.side = side;
        one.needsUpdate = true;
      }
    };
    /** Draw few triangles a grain, or all of them again. */
    const setCoarse = (coarse) => {
      if (coarse && !few) {
        few = new THREE.BufferGeometry();
        for (const [name, attribute] of Object.entries(all.attributes)) few.setAttribute(name, attribute);
        few.setIndex(new THREE.BufferAttribute(coarseIndex(shapes), 1));
      }
      mesh.geometry = coarse ? few : all;
    };
    /** Row of the grain drawn at a pixel (CSS pixels of the canvas); −1 for none. */
    const pick = (renderer, camera, x, y, coarsely) => {
      const { clientWidth: w, clientHeight: h } = renderer.domElement;
      camera.setViewOffset(w, h, x, y, 1, 1);
      mesh.material = ids;
      if (coarsely) setCoarse(true);
      pickScene.add(mesh);
      renderer.setRenderTarget(target);
      renderer.clear();
      renderer.render(pickScene, camera);
      renderer.readRenderTargetPixels(target, 0, 0, 1, 1, pixel);
      renderer.setRenderTarget(null);
      mesh.material = drawn;
      if (coarsely) setCoarse(false);
      group.add(mesh);
      camera.clearViewOffset();
      return pixel[0] + 256 * pixel[1] + 65536 * pixel[2] - 1;
    };
    const cap = gm.viewerCap.create({ mesh, group, uniforms, count: n }, VERTEX, (row) => texel(row, 2));
    group.add(cap.face);
    return {
      group, mesh, uniforms, cap, places, hidden, setPoses, setColours, mark, cut, pick, setCoarse, count: n, radii: shapes.radii,
      triangles: shapes.index.length / 3,
    };
  };

  gm.viewerGrains = { create };
})();
