"use strict";
// Grains of the state that need a look: those that did not converge, grouped by status and reason.
(() => {
  const gm = (window.gm ??= {});
  const { el } = gm;
  const SHOWN = 24; // labels of a group before "all"

  const groupsOf = (app, status, reasons) => {
    const groups = new Map();
    app.data.grains.labels.forEach((label, row) => {
      const record = app.data.statuses[status[row]];
      if (!record || record.name === "converged") return;
      const key = `${record.name} ${reasons[row] ?? ""}`;
      if (!groups.has(key)) groups.set(key, { record, reason: reasons[row] ?? "", labels: [] });
      groups.get(key).labels.push(label);
    });
    return [...groups.values()].sort((a, b) => b.labels.length - a.labels.length);
  };

  const labelButtons = (app, labels) => {
    const button = (label) => el("button", {
      type: "button", "data-label": label, "aria-pressed": String(label === app.grain), "aria-label": `Grain ${label}`,
      onclick: () => app.setGrain(label),
    }, String(label));
    const list = el("div", { class: "labels" }, labels.slice(0, SHOWN).map(button));
    if (labels.length > SHOWN) {
      const rest = el("button", { type: "button", class: "more", onclick: () => {
        const more = labels.slice(SHOWN).map(button);
        rest.replaceWith(...more);
        more[0].focus();
      } },
        `${labels.length - SHOWN} more`);
      list.append(rest);
    }
    return list;
  };

  const item = (app, { record, reason, labels }) => el("li", {},
    el("span", { class: "chip", style: `--dot: ${record.colour}`, title: record.meaning },
      el("span", { class: "dot" }), `${labels.length} ${record.name}`),
    el("p", { class: "reason" }, reason || record.meaning),
    labelButtons(app, labels));

  gm.attention = {
    mount(place, app) {
      if (app.state < 0) return;
      const show = async () => {
        const index = app.state;
        const [status, reasons] = await Promise.all([app.status(index), app.reasons(index)]);
        if (index !== app.state) return;
        const groups = groupsOf(app, status, reasons);
        const total = app.data.states[index].grains;
        if (!groups.length) {
          place.replaceChildren(total ? el("p", { class: "finding ok" }, `All ${total} grains of ${app.data.states[index].name} converged.`) : el("p", { class: "quiet" }, "This state has no grains."));
          return;
        }
        const names = app.data.states.length > 1 ? ` in ${app.data.states[index].name}` : "";
        const card = el("div", { class: "card attention" }, el("h3", {}, `Grains that need a look${names}`),
          el("ul", {}, groups.map((group) => item(app, group))));
        place.replaceChildren(card);
      };
      app.on("state", show);
      app.on("grain", () => {
        for (const button of place.querySelectorAll("[data-label]")) {
          button.setAttribute("aria-pressed", String(Number(button.dataset.label) === app.grain));
        }
      });
      show();
    },
  };
})();
