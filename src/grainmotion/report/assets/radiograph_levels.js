"use strict";
// Colour bars of radiographs, with sliders for the values at their ends.
(() => {
  const gm = (globalThis.gm ??= {});
  const STEPS = 400;
  const OCTAVES = 5; // how much weaker or stronger than at first residuals may be coloured: factors of two

  /**
   * Bars and sliders that change `scale` = { low, high, limit } in place and call `changed()`; `standard` is the scale
   * that the button returns to.
   */
  gm.radiographLevels = (data, scale, standard, changed) => {
    const coded = data.states.flatMap((state) => state.views).flatMap((view) => (view.images ? [view.coding] : []));
    const least = Math.min(standard.low, ...coded.map((c) => c.low));
    const most = Math.max(standard.high, ...coded.map((c) => c.low + 254 * c.step));
    const span = (most - least) / STEPS;
    const updates = [];

    const slider = (name, bounds, value, set) => {
      const input = gm.el("input", { type: "range", min: bounds[0], max: bounds[1], step: (bounds[1] - bounds[0]) / STEPS });
      input.addEventListener("input", () => {
        set(Number(input.value));
        refresh();
        changed();
      });
      updates.push(() => {
        input.value = value();
        input.setAttribute("aria-valuetext", name.text());
      });
      return gm.el("label", {}, gm.el("span", {}, name.title), input);
    };

    const bar = (title, mapName, ends) => {
      const texts = ends.map(() => gm.el("span"));
      updates.push(() => ends.forEach((end, k) => (texts[k].textContent = gm.significant(end()))));
      const strip = gm.el("div", { class: "strip", style: `background: ${gm.colours.gradient(mapName)}` });
      return gm.el("div", { class: "bar" }, gm.el("span", { class: "title" }, title), strip, gm.el("div", { class: "ticks" }, texts));
    };

    const refresh = () => updates.forEach((update) => update());
    const middle = () => (scale.low + scale.high) / 2;
    const element = gm.el("div", { class: "levels" },
      gm.el("div", {},
        bar("line integral (measured, simulated)", "grey", [() => scale.low, middle, () => scale.high]),
        slider({ title: "black at", text: () => gm.significant(scale.low) }, [least, most], () => scale.low, (v) => {
          scale.low = Math.min(v, scale.high - span);
        }),
        slider({ title: "white at", text: () => gm.significant(scale.high) }, [least, most], () => scale.high, (v) => {
          scale.high = Math.max(v, scale.low + span);
        })),
      gm.el("div", {},
        bar("residual = measured − simulated", "vik", [() => -scale.limit, () => 0, () => scale.limit]),
        slider({ title: "range ±", text: () => gm.significant(scale.limit) }, [-OCTAVES, OCTAVES],
          () => Math.log2(scale.limit / standard.limit), (v) => (scale.limit = standard.limit * 2 ** v)),
        gm.el("button", {
          type: "button",
          onclick: () => {
            Object.assign(scale, standard);
            refresh();
            changed();
          },
        }, "reset contrast")));
    refresh();
    return element;
  };
})();
