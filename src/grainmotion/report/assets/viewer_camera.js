"use strict";
// The camera: turned about the sample by mouse, touch and keys; z is up.
(() => {
  const gm = (window.gm ??= {});
  const FIELD_OF_VIEW = 28; // degrees
  const VIEWS = { // azimuth and elevation of the eye, degrees
    default: [-58, 20], front: [-90, 0], side: [0, 0], top: [-90, 89.9],
  };
  const AXES = [["x", [1, 0, 0], "#d1495b"], ["y", [0, 1, 0], "#3f9a52"], ["z", [0, 0, 1], "#3b7dd8"]];

  const create = (canvas, onChange) => {
    const camera = new THREE.PerspectiveCamera(FIELD_OF_VIEW, 1, 0.1, 1000);
    camera.up.set(0, 0, 1);
    const controls = new THREE.OrbitControls(camera, canvas);
    Object.assign(controls, { enableDamping: false, rotateSpeed: 0.9, zoomToCursor: true, screenSpacePanning: true });
    let center = [0, 0, 0], radius = 1;
    controls.addEventListener("change", () => {
      const distance = camera.position.distanceTo(controls.target);
      camera.near = Math.max(distance - 4 * radius, distance * 0.01);
      camera.far = distance + 4 * radius;
      camera.updateProjectionMatrix();
      onChange();
    });

    const place = (azimuth, elevation, distance) => {
      const a = (azimuth * Math.PI) / 180, e = (elevation * Math.PI) / 180, t = controls.target;
      camera.position.set(
        t.x + distance * Math.cos(e) * Math.cos(a), t.y + distance * Math.cos(e) * Math.sin(a), t.z + distance * Math.sin(e));
      controls.update();
      controls.dispatchEvent({ type: "change" });
    };
    /** Azimuth and elevation (degrees) and distance (mm) of the eye from what it looks at. */
    const where = () => {
      const d = camera.position.clone().sub(controls.target), distance = d.length();
      return [Math.atan2(d.y, d.x), Math.asin(d.z / distance)].map((v) => (v * 180) / Math.PI).concat(distance);
    };
    /** The distance from which a ball of the sample's radius fills the canvas. */
    const fitting = () => {
      const half = (FIELD_OF_VIEW * Math.PI) / 360, across = Math.atan(Math.tan(half) * Math.min(1, camera.aspect));
      return (0.93 * radius) / Math.sin(across);
    };
    return {
      camera, controls, where,
      frame(newCenter, newRadius) {
        center = newCenter;
        radius = newRadius;
        controls.minDistance = 0.05 * radius;
        controls.maxDistance = 30 * radius;
      },
      view(name) {
        controls.target.set(...center);
        place(...VIEWS[name], fitting());
      },
      turn(azimuth, elevation) {
        const [a, e, distance] = where();
        place(a + azimuth, Math.min(Math.max(e + elevation, -89.9), 89.9), distance);
      },
      zoom(factor) {
        const [a, e, distance] = where();
        place(a, e, Math.min(Math.max(distance * factor, controls.minDistance), controls.maxDistance));
      },
      resize(width, height) {
        camera.aspect = width / Math.max(height, 1);
        camera.updateProjectionMatrix();
      },
    };
  };

  /** The axes of the sample as a small drawing that follows the camera: { element, update(camera) }. */
  const triad = () => {
    const parts = AXES.map(([name, axis, colour]) => ({
      axis, line: gm.svg("line", { x1: 0, y1: 0, stroke: colour, "stroke-width": 2.5, "stroke-linecap": "round" }),
      text: gm.svg("text", { fill: colour, "text-anchor": "middle", dy: ".35em", "font-weight": 650, "font-size": 13 }, name),
    }));
    const lines = gm.svg("g");
    const element = gm.svg("svg", { viewBox: "-40 -40 80 80", class: "viewer-triad", "aria-hidden": "true" }, lines);
    const update = (camera) => {
      const seen = parts.map((part) => {
        const v = new THREE.Vector3(...part.axis).applyQuaternion(camera.quaternion.clone().invert());
        return { ...part, v };
      });
      seen.sort((a, b) => a.v.z - b.v.z);
      for (const { line, text, v } of seen) {
        line.setAttribute("x2", 25 * v.x);
        line.setAttribute("y2", -25 * v.y);
        text.setAttribute("x", 34 * v.x);
        text.setAttribute("y", -34 * v.y);
        lines.append(line, text);
      }
    };
    return { element, update };
  };

  gm.viewerCamera = { create, triad, FIELD_OF_VIEW };
})();
