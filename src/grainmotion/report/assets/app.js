"use strict";
// What the page shows: which state, which grain, which theme. Components listen to it and never call each other.
(() => {
  const gm = (window.gm ??= {});
  const data = JSON.parse(document.getElementById("report-data").textContent);
  const listeners = { state: [], grain: [], theme: [], ready: [] };
  const rowOf = new Map(data.grains.labels.map((label, row) => [label, row]));
  const quantities = new Map(data.quantities.map((quantity) => [quantity.key, quantity]));
  const derived = new Map();
  const system = window.matchMedia("(prefers-color-scheme: dark)");
  let isReady = false;

  const emit = (name) => {
    for (const listener of listeners[name]) listener(app);
  };

  const mean = (column) => {
    let sum = 0, count = 0;
    for (const value of column) if (Number.isFinite(value)) { sum += value; count++; }
    return count ? sum / count : 0;
  };

  /** Length, root mean square or sum of columns, number by number. */
  const combine = (columns, how) => {
    const shifts = columns.map((column) => (how === "norm_less_mean" ? mean(column) : 0));
    return Float32Array.from(columns[0], (_, row) => {
      let squares = 0, sum = 0;
      columns.forEach((column, k) => {
        const value = column[row] - shifts[k];
        squares += value * value;
        sum += value;
      });
      return how === "sum" ? sum : Math.sqrt(how === "rms" ? squares / columns.length : squares);
    });
  };

  const app = {
    data,
    state: data.states.length - 1, // −1 where there is only the reference
    grain: null, // the label of the selected grain
    theme: system.matches ? "dark" : "light",

    /** Show the state of this index. */
    setState(index) {
      if (index === app.state || !data.states[index]) return;
      app.state = index;
      emit("state");
    },

    /** Select the grain of this label; none with null. */
    setGrain(label) {
      if (label === app.grain || (label !== null && !rowOf.has(label))) return;
      app.grain = label;
      emit("grain");
    },

    /** "light", "dark", or null for the system's. */
    setTheme(name) {
      app.theme = name ?? (system.matches ? "dark" : "light");
      document.documentElement.dataset.theme = app.theme;
      emit("theme");
    },

    /** Call `listener(app)` on "state", "grain", "theme" or "ready" (at once if the page is ready). */
    on(name, listener) {
      listeners[name].push(listener);
      if (name === "ready" && isReady) listener(app);
    },

    /** Row of a grain in all columns; −1 for an unknown label. */
    row: (label) => rowOf.get(label) ?? -1,
    quantity: (key) => quantities.get(key),

    /** Promise of the values of a quantity in a state, a Float32Array by row; all NaN where the state lacks it. */
    column(index, key) {
      const id = `${index} ${key}`;
      if (!derived.has(id)) derived.set(id, column(index, key));
      return derived.get(id);
    },
    /** As `column`, with NaN for translations and rotations that are no results to use. */
    usable(index, key) {
      const id = `usable ${index} ${key}`;
      if (!derived.has(id)) derived.set(id, usable(index, key));
      return derived.get(id);
    },
    status: (index) => gm.decode(data.states[index].status), // 255 where the state lacks the grain
    ok: (index, part) => gm.decode(data.states[index].ok[part]), // part: "translation" or "rotation"
    reasons: (index) => gm.decode(data.states[index].reasons), // sentences by row
    fit: (index) => gm.decode(data.states[index].fit),
    /** Promise of { direction, sd, least } of all rows; part: "translation" (mm) or "rotation" (degrees). */
    async weak(index, part) {
      const names = ["a", "b", "sd", "least"];
      const [a, b, sd, least] = await Promise.all(names.map((name) => ofState(index, data.weak[part][name])));
      const direction = new Float32Array(3 * a.length);
      for (let row = 0; row < a.length; row++) {
        if (Number.isNaN(a[row])) continue;
        const vector = [a[row], b[row], 1 - Math.abs(a[row]) - Math.abs(b[row])], length = Math.hypot(...vector);
        const largest = vector.reduce((most, c) => (Math.abs(c) > Math.abs(most) ? c : most), 0);
        direction.set(vector.map((c) => (Math.sign(largest) * c) / length), 3 * row);
      }
      return { direction, sd, least };
    },
  };

  /** The part of a state of what is stored for all states together. */
  const ofState = async (index, embedded) => {
    const all = await gm.decode(embedded), n = data.grains.labels.length;
    return all.subarray(index * n, (index + 1) * n);
  };

  const column = async (index, key) => {
    if (data.states[index].columns.includes(key)) return ofState(index, data.columns[key]);
    if (key === "status") return Float32Array.from(await app.status(index), (k) => (k === 255 ? NaN : k));
    const { of = [], how } = quantities.get(key) ?? {};
    if (!of.length) return new Float32Array(data.grains.labels.length).fill(NaN);
    return combine(await Promise.all(of.map((name) => app.column(index, name))), how);
  };

  const usable = async (index, key) => {
    const { group, of = [], how } = quantities.get(key) ?? {}, part = { Translation: "translation", Rotation: "rotation" }[group];
    if (!part) return app.column(index, key);
    if (of.length) return combine(await Promise.all(of.map((name) => app.usable(index, name))), how);
    const [values, ok] = await Promise.all([app.column(index, key), app.ok(index, part)]);
    return values.map((value, row) => (ok[row] ? value : NaN));
  };

  system.addEventListener("change", () => app.setTheme(null));
  document.documentElement.dataset.theme = app.theme;

  gm.app = app;
  gm.ready = () => {
    isReady = true;
    document.documentElement.dataset.ready = "yes";
    emit("ready");
  };
})();
