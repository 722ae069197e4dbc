"use strict";
// Bodies beside the grains, such as pistons and a container's wall: translucent, moved by their own motions.
(() => {
  const gm = (window.gm ??= {});
  const VERTEX = `
    out vec3 vPlace, vNormal, vWorld;
    void main() {
      vec4 world = modelMatrix * vec4(position, 1.0), seen = viewMatrix * world;
      vWorld = world.xyz;
      vPlace = seen.xyz;
      vNormal = normalMatrix * normal;
      gl_Position = projectionMatrix * seen;
    }`;
  const FRAGMENT = `
    in vec3 vPlace, vNormal, vWorld;
    uniform vec3 tint, cutAxis;
    uniform vec2 cutRange;
    out vec4 colour;
    void main() {
      float s = dot(vWorld, cutAxis);
      if (s < cutRange.x || s > cutRange.y) discard;
      float facing = abs(dot(normalize(vNormal), normalize(-vPlace)));
      colour = vec4(pow(tint, vec3(1.0 / 2.2)), 0.07 + 0.35 * pow(1.0 - facing, 2.0)); // edges seen better than faces
    }`;

  /** Meshes of bodies, each about its centre of mass. */
  const load = async (bodies, surfaces, cut) => {
    const { vertices, triangles, scales, vertexCounts, triangleCounts } = await gm.viewerShapes.unpacked(surfaces);
    let v = 0, t = 0;
    return bodies.map((body, row) => {
      const points = Float32Array.from(vertices.subarray(v, (v += 3 * vertexCounts[row])), (step) => step * scales[row]);
      const geometry = new THREE.BufferGeometry();
      geometry.setAttribute("position", new THREE.BufferAttribute(points, 3));
      geometry.setIndex(new THREE.BufferAttribute(triangles.slice(t, (t += 3 * triangleCounts[row])), 1));
      geometry.computeVertexNormals();
      const material = new THREE.ShaderMaterial({
        glslVersion: THREE.GLSL3, vertexShader: VERTEX, fragmentShader: FRAGMENT, side: THREE.DoubleSide, transparent: true,
        depthWrite: false, uniforms: { tint: { value: new THREE.Color() }, cutAxis: cut.cutAxis, cutRange: cut.cutRange },
      });
      const mesh = new THREE.Mesh(geometry, material);
      mesh.userData.body = body;
      return mesh;
    });
  };

  /** The bodies of a scene record as an object of the scene; `cut` holds where grains are cut, as bodies are too. */
  const create = async ({ bodies, surfaces }, cut) => {
    const group = new THREE.Group(), meshes = surfaces ? await load(bodies, surfaces, cut) : [];
    if (meshes.length) group.add(...meshes);
    /** Put them where a multiple of their motion in a state takes them. */
    const move = (state, factor) => {
      for (const { userData: { body }, position, quaternion } of meshes) {
        const motion = body.motions[state]?.map((value) => factor * value) ?? [0, 0, 0, 0, 0, 0];
        position.set(...body.center.map((value, k) => value + motion[k]));
        quaternion.set(...gm.viewerMotion.ofVector(motion.slice(3)));
      }
    };
    const setColour = (colour) => meshes.forEach((mesh) => mesh.material.uniforms.tint.value.copy(colour));
    return { group, move, setColour };
  };

  gm.viewerBodies = { create };
})();
