"use strict";
// How the fit of a state went as a whole: facts, convergence, notes, and tables of views, bodies, new grains and pieces.
(() => {
  const gm = (window.gm ??= {});
  const { el } = gm;

  const factList = (rows) => el("dl", { class: "facts" }, rows.map(([name, value]) => el("div", {}, el("dt", {}, name), el("dd", {}, value))));

  const convergence = (costs) => {
    let at = 0;
    const series = costs.map(({ name, values }) => {
      const one = { name, values: values.map((value) => value ?? NaN), at, part: true };
      at += values.length;
      return one;
    });
    if (!at) return null;
    return el("figure", { class: "card" }, gm.chart({
      title: "Convergence of the fit: relative residual by iteration", series, x: Array.from({ length: at }, (_, i) => i + 1),
      xTitle: "iteration", yTitle: "relative residual", log: true, height: 240,
    }), el("figcaption", {}, "Relative residual ‖b − aP − b₀‖ / ‖b‖ after each iteration. Stages filter the images differently, so that their values do not compare."));
  };

  const table = ({ title, caption, head, rows }) => {
    const body = head.length
      ? el("div", { class: "scroll card", tabindex: 0, role: "region", "aria-label": title }, el("table", {},
        el("thead", {}, el("tr", {}, head.map((name) => el("th", { scope: "col" }, name)))),
        el("tbody", {}, rows.map((row) => el("tr", {}, row.map((cell, k) => (k ? el("td", {}, cell) : el("th", { scope: "row" }, cell))))))))
      : factList(rows);
    return el("div", {}, el("h3", {}, title), el("p", { class: "quiet" }, caption), body);
  };

  gm.fit = {
    mount(place, app) {
      if (app.state < 0) return;
      const show = async () => {
        const index = app.state, fit = await app.fit(index);
        if (index !== app.state) return;
        place.replaceChildren(
          el("div", { class: "columns" }, el("div", {}, factList(fit.facts), fit.notes.map((note) => el("p", { class: "finding" }, note))),
            convergence(fit.costs)),
          ...fit.tables.map(table));
      };
      app.on("state", show);
      show();
    },
  };

  gm.reference = {
    mount(place, app) {
      const errors = app.data.reconstruction_errors;
      if (!errors.length) return;
      place.replaceChildren(gm.chart({
        title: "Convergence of the reconstruction: relative residual by iteration", x: errors.map((_, i) => i + 1),
        series: [{ name: "", values: errors.map((value) => value ?? NaN), part: true }], xTitle: "iteration", yTitle: "relative residual", log: true, height: 220,
      }), el("figcaption", {}, "Reconstruction: relative residual ε = ‖b − Ax‖ / ‖b‖ after each iteration."));
    },
  };

  for (const button of document.querySelectorAll(".code .copy")) {
    button.addEventListener("click", async () => {
      const text = button.parentNode.querySelector("code");
      try {
        await navigator.clipboard.writeText(text.textContent);
        button.textContent = "Copied";
      } catch {
        getSelection().selectAllChildren(text); // pages from a file may not write to the clipboard everywhere
        button.textContent = "Selected";
      }
      setTimeout(() => { button.textContent = "Copy"; }, 2000);
    });
  }
})();
