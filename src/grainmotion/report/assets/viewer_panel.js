"use strict";
// The viewer's controls: what colours, arrows, motion, cut and statuses are shown.
(() => {
  const gm = (window.gm ??= {});
  const { el } = gm;
  const MAGNIFICATIONS = [1, 2, 3, 5, 10, 20, 30, 50, 100, 200, 500, 1000];
  const ARROWS = [["none", "No arrows"], ["u", "Displacement"], ["w", "Rotation"]];
  const CUTS = [["", "No cut"], ["x", "Cut along x"], ["y", "Cut along y"], ["z", "Cut along z"]];
  const PERIOD = 2600; // ms of a movement there and back

  const select = (label, name, options, chosen, onchange) => el("label", { class: "viewer-field" },
    el("span", {}, label),
    el("select", { "data-control": name, onchange: (event) => onchange(event.target.value) },
      options.map(([value, text]) => Array.isArray(text)
        ? el("optgroup", { label: value }, text.map(([v, t]) => el("option", { value: v, selected: v === chosen }, t)))
        : el("option", { value, selected: value === chosen }, text))));

  const slider = (label, name, [low, high, step], value, oninput) => el("input", {
    type: "range", min: low, max: high, step, value, "aria-label": label, title: label, "data-control": name,
    oninput: (event) => oninput(Number(event.target.value)),
  });

  /** Whole titles by key: "… along x" begins as the title before it does. */
  const titles = (quantities) => {
    let whole = "";
    return new Map(quantities.map(({ key, title }) => {
      if (!title.startsWith("…")) whole = title;
      return [key, title.replace("…", whole)];
    }));
  };

  /** Quantities to colour by, in their groups. */
  const quantityOptions = (quantities) => {
    const groups = new Map(), names = titles(quantities);
    for (const { key, group } of quantities) groups.set(group, [...(groups.get(group) ?? []), [key, names.get(key)]]);
    return [...groups];
  };

  /**
   * The controls of a viewer: { top, bottom }.  `settings` is changed and `changed(what)` called, with "colour",
   * "arrows", "motion", "relative" or "cut"; `actions` are the functions of the buttons.
   */
  const create = (app, settings, changed, actions) => {
    const set = (name, what) => (value) => { settings[name] = value; changed(what); };
    const button = (text, title, onclick, name) => el("button", { type: "button", title, onclick, "data-control": name }, text);
    const top = el("div", { class: "viewer-bar" },
      select("Colour", "colour", quantityOptions(app.data.quantities), settings.colour, set("colour", "colour")),
      app.data.states.length ? select("Arrows", "arrows", ARROWS, settings.arrows, set("arrows", "arrows")) : null,
      el("span", { class: "viewer-gap" }),
      el("span", { class: "segmented", role: "group", "aria-label": "View from" },
        [["default", "Reset", "The whole sample, from the front and above (key 0)"], ["top", "Top", "From above, along −z"],
          ["front", "Front", "From the front, along y"], ["side", "Side", "From the side, along −x"]]
          .map(([name, text, title]) => button(text, title, () => actions.view(name), `view-${name}`))),
      button("Save image", "Download what is shown as a PNG image", actions.save, "save"));

    const share = el("output", { class: "viewer-number" });
    const before = slider("Motion: 0 is the reference, 1 the state", "share", [0, 1, 0.01], 1, (value) => {
      stop();
      setShare(value);
    });
    const setShare = (value) => {
      settings.share = value;
      before.value = value;
      share.textContent = value === 0 ? "reference" : value === 1 ? "state" : gm.fixed(value, 2);
      changed("motion");
    };
    let playing = 0;
    const play = button("▶", "Move between reference and state", () => (playing ? stop() : start()), "play");
    const start = () => {
      const began = performance.now();
      play.textContent = "⏸";
      const step = (now) => {
        setShare(Number((0.5 - 0.5 * Math.cos((2 * Math.PI * (now - began)) / PERIOD)).toFixed(3)));
        playing = requestAnimationFrame(step);
      };
      playing = requestAnimationFrame(step);
    };
    const stop = () => {
      cancelAnimationFrame(playing);
      playing = 0;
      play.textContent = "▶";
    };
    share.textContent = "state";

    const cutSliders = el("span", { class: "viewer-cut", hidden: true },
      slider("Place of the cut", "cut-place", [0, 1, 0.005], settings.cutPlace, set("cutPlace", "cut")),
      el("label", { class: "viewer-field" }, el("span", {}, "thickness"),
        slider("Thickness of what is shown; the whole rest at the right end", "cut-thickness", [0.02, 1, 0.01],
          settings.cutThickness, set("cutThickness", "cut"))));
    const cut = select("Look inside", "cut", CUTS, "", (value) => {
      cutSliders.hidden = !value;
      set("cutAxis", "cut")(value);
    });
    const motion = app.data.states.length ? [
      el("span", { class: "viewer-field" }, el("span", {}, "Motion"), play, before, share),
      select("magnified", "magnification", MAGNIFICATIONS.map((m) => [String(m), `× ${m}`]), "1",
        (value) => set("magnification", "motion")(Number(value))),
      select("relative to", "relative", [["", "the scanner"], ["sample", "the sample"]], "",
        (value) => set("relative", "relative")(value !== "")),
    ] : [];
    const bottom = el("div", { class: "viewer-bar" }, motion, cut, cutSliders);
    return { top, bottom };
  };

  /** Buttons of the statuses that occur, each of which hides its grains: { element, update(numbers) }. */
  const statusButtons = (statuses, hidden, changed) => {
    const element = el("div", { class: "viewer-statuses", role: "group", "aria-label": "Grains shown, by status" });
    const update = (numbers) => {
      const counts = statuses.map((_, k) => gm.count(Array.from(numbers), k));
      gm.refill(element, statuses.flatMap((status, k) => counts[k] === 0 ? [] : [el("button", {
        type: "button", class: "chip", "aria-pressed": String(!hidden.has(k)), "data-status": status.name,
        title: `${status.meaning}. Click to ${hidden.has(k) ? "show" : "hide"} these grains.`,
        onclick: () => {
          if (!hidden.delete(k)) hidden.add(k);
          changed();
        },
      }, el("span", { class: "dot", style: `--dot: ${status.colour}` }), `${status.name} ${counts[k]}`)]));
    };
    return { element, update };
  };

  gm.viewerPanel = { create, statusButtons, titles };
})();
