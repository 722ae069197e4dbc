"use strict";
// The top of the page: headline figures, grains by status, the slider of states, light and dark.
(() => {
  const gm = (window.gm ??= {});
  const { el } = gm;

  const merit = (value, unit, ...captions) => el("div", { class: "figure-of-merit" },
    el("b", {}, value, unit ? el("small", {}, ` ${unit}`) : null), captions.filter(Boolean).map((caption) => el("span", {}, caption)));

  const figures = async (place, app) => {
    const index = app.state, { data } = app;
    const [u, w, sdU, sdW, translation, rotation] = await Promise.all([
      ...["u", "w"].map((key) => app.usable(index, key)), ...["sd_u", "sd_w"].map((key) => app.column(index, key)),
      app.ok(index, "translation"), app.ok(index, "rotation"),
    ]);
    if (index !== app.state) return;
    const total = data.states[index].grains, voxel = data.voxel_size;
    const usable = (flags) => `${gm.count(flags, 1)}`;
    const share = (flags) => (total ? `${Math.floor((100 * gm.count(flags, 1)) / total)} % of ${total}` : "");
    const used = (column, flags) => column.filter((_, row) => flags[row]);
    const displacement = gm.median(u), deviation = gm.median(used(sdU, translation));
    const voxels = (length) => (Number.isFinite(length) && voxel ? `${gm.significant(length / voxel, 2)} voxels` : "");
    place.replaceChildren(
      merit(String(total), "", total === 1 ? "grain" : "grains"),
      merit(usable(translation), "", "translations to use", share(translation)),
      merit(usable(rotation), "", "rotations to use", share(rotation)),
      merit(gm.significant(displacement), "mm", "median displacement", voxels(displacement)),
      merit(gm.significant(gm.median(w)), "°", "median rotation"),
      merit(gm.significant(deviation, 2), "mm", "median sd, translation", voxels(deviation)),
      merit(gm.significant(gm.median(used(sdW, rotation)), 2), "°", "median sd, rotation"),
    );
  };

  const shares = async (place, app) => {
    const index = app.state, status = await app.status(index);
    if (index !== app.state) return;
    const found = app.data.statuses.map((record, k) => [record, gm.count(status, k)]).filter(([, count]) => count);
    const bar = el("div", { class: "share", "aria-hidden": "true" },
      found.map(([record, count]) => el("span", { style: `flex: ${count}; --dot: ${record.colour}` })));
    const legend = el("div", { class: "legend" }, found.map(([record, count]) => el("span", {
      class: "chip", title: record.meaning, style: `--dot: ${record.colour}`,
    }, el("span", { class: "dot" }), `${count} ${record.name}`)));
    place.replaceChildren(bar, legend);
  };

  const stateControl = (place, app) => {
    const { states } = app.data, last = states.length - 1;
    const slider = el("input", {
      type: "range", min: 0, max: last, step: 1, "aria-label": "State", oninput: () => app.setState(Number(slider.value)),
    });
    const step = (by, name, sign) =>
      el("button", { type: "button", class: "button icon", "aria-label": name, title: name, onclick: () => app.setState(app.state + by) }, sign);
    const back = step(-1, "Previous state", "‹"), forth = step(1, "Next state", "›");
    const name = el("output", { "aria-live": "polite" }), count = el("span", { class: "quiet" });
    place.append(back, slider, forth, name, count);
    return () => {
      const state = states[app.state];
      slider.value = app.state;
      slider.setAttribute("aria-valuetext", state.name);
      name.textContent = name.title = state.name;
      count.textContent = `${app.data.state_numbers[app.state]} of ${app.data.state_count}${state.time === null ? "" : `, time ${state.time}`}`;
      for (const [button, end] of [[back, 0], [forth, last]]) {
        if (app.state === end && document.activeElement === button) slider.focus(); // a disabled button takes no keys
        button.disabled = app.state === end;
      }
    };
  };

  const themeButton = (button, app) => {
    const show = () => {
      const other = app.theme === "dark" ? "light" : "dark";
      button.textContent = app.theme === "dark" ? "☀" : "☾";
      button.title = `Switch to ${other} colours`;
      button.setAttribute("aria-label", button.title);
    };
    button.addEventListener("click", () => app.setTheme(app.theme === "dark" ? "light" : "dark"));
    app.on("theme", show);
    show();
  };

  /** A way back to the chosen grain from any section. */
  const chosenGrain = (link, app) => app.on("grain", () => {
    link.hidden = app.grain === null;
    link.textContent = `Grain ${app.grain} ↑`;
  });

  const summaryRows = (app) => {
    const buttons = [...document.querySelectorAll("button[data-state]")];
    for (const button of buttons) button.addEventListener("click", () => app.setState(Number(button.dataset.state)));
    return () => buttons.forEach((button) => {
      const row = button.closest("tr");
      if (Number(button.dataset.state) === app.state) row.setAttribute("aria-current", "true");
      else row.removeAttribute("aria-current");
    });
  };

  gm.header = {
    mount(place, app) {
      themeButton(document.getElementById("theme"), app);
      chosenGrain(document.getElementById("chosen-grain"), app);
      if (app.state < 0) return;
      const control = document.getElementById("state-control");
      const updates = [summaryRows(app), ...(control ? [stateControl(control, app)] : [])];
      const names = document.querySelectorAll("[data-state-name]");
      const show = () => {
        for (const update of updates) update();
        for (const name of names) name.textContent = app.data.states[app.state].name;
        figures(document.getElementById("figures"), app);
        shares(document.getElementById("status-bar"), app);
      };
      app.on("state", show);
      show();
    },
  };
})();
