"use strict";
// Mounts the components on the page, in the order of the page.
(() => {
  const PLACES = [
    ["header", "header"], ["viewer", "viewer"], ["panel", "grain-panel"], ["shadows", "shadows"], ["history", "history"],
    ["attention", "attention"], ["table", "grain-table"], ["radiographs", "radiographs"], ["fit", "fit"],
    ["reference", "reconstruction-curve"], ["slices", "slices"],
  ];
  for (const [name, id] of PLACES) {
    const place = document.getElementById(id);
    if (place && gm[name]) gm[name].mount(place, gm.app);
  }
  gm.ready();
})();
