"use strict";
// The chosen grain: its motion with standard deviations, status, reason and weak directions.
(() => {
  const gm = (window.gm ??= {});
  const { el } = gm;
  const AXES = ["x", "y", "z"];

  const values = async (app, index, row, keys) => {
    const columns = await Promise.all(keys.map((key) => app.column(index, key)));
    return columns.map((column) => column[row]);
  };

  /** A row of the table of the motion: three components and their length, each with its sd. */
  const motionRow = (app, { title, unit, digits, used }, parts, sds, length) => {
    const text = (value) => gm.quantityText({ digits, key: "" }, value, app.data.length_decimals);
    const cell = (value, sd) => el("td", {}, text(value), Number.isFinite(sd) ? el("span", { class: "sd" }, el("br"), `± ${gm.significant(sd, 2)}`) : null);
    return el("tr", { class: used ? "" : "unused", title: used ? "" : "not a result to use" },
      el("th", { scope: "row" }, title, el("br"), el("span", { class: "quiet" }, unit)), parts.map((part, k) => cell(part, sds[k])), cell(length));
  };

  const motionTable = async (app, index, row) => {
    const [u, sdU, w, sdW, [lengthU, lengthW], okU, okW] = await Promise.all([
      values(app, index, row, AXES.map((a) => `u${a}`)), values(app, index, row, AXES.map((a) => `sd_u${a}`)),
      values(app, index, row, AXES.map((a) => `w${a}`)), values(app, index, row, AXES.map((a) => `sd_w${a}`)),
      values(app, index, row, ["u", "w"]), app.ok(index, "translation"), app.ok(index, "rotation"),
    ]);
    const head = el("thead", {}, el("tr", {}, el("td"), [...AXES, "length"].map((name) => el("th", { scope: "col" }, name))));
    const unused = [okU[row] ? null : "translation", okW[row] ? null : "rotation"].filter(Boolean);
    const told = unused.length === 2 ? "Neither translation nor rotation is a result to use." : `The ${unused[0]} is not a result to use.`;
    return [
      el("table", { class: "motion" }, el("caption", { class: "sr" }, "Motion and standard deviations"), head, el("tbody", {},
        motionRow(app, { title: "Translation", unit: "mm", digits: "length", used: okU[row] }, u, sdU, lengthU),
        motionRow(app, { title: "Rotation vector", unit: "degrees", digits: "angle", used: okW[row] }, w, sdW, lengthW))),
      unused.length ? el("p", { class: "quiet" }, told) : null,
    ];
  };

  /** "along x", "nearly along x" or "along (0.61, −0.79, 0.05)". */
  const direction = (word, vector) => {
    const sizes = vector.map(Math.abs), most = Math.max(...sizes), axis = AXES[sizes.indexOf(most)];
    if (most > 0.985) return `${word} ${axis}`;
    return most > 0.9 ? `nearly ${word} ${axis}` : `${word} (${vector.map((c) => gm.fixed(c, 2)).join(", ")})`;
  };

  const weakSentences = async (app, index, row) => {
    const kinds = [["translation", "Translation", "along", "mm"], ["rotation", "Rotation", "about", "°"]];
    const sentences = await Promise.all(kinds.map(async ([part, name, word, unit]) => {
      const { direction: d, sd, least } = await app.weak(index, part);
      if (!(sd[row] > 0)) return null;
      const deviation = `${gm.significant(sd[row], 2)} ${unit}`.replace(" °", "°");
      const ratio = sd[row] / least[row];
      if (!(ratio > 1.5)) return `${name} is known about equally well in all directions: sd ${deviation}.`;
      const where = direction(word, [...d.subarray(3 * row, 3 * row + 3)]);
      const times = ratio < 1000 ? `${gm.significant(ratio, 2)} times` : "more than 1000 times";
      return `${name} is known least ${where}: sd ${deviation}, ${times} that of the best direction.`;
    }));
    const known = sentences.filter(Boolean);
    return known.length ? el("ul", { class: "weak" }, known.map((sentence) => el("li", {}, sentence))) : null;
  };

  const facts = async (app, index, row) => {
    const [centers, diameters, [residual, iterations]] = await Promise.all([
      gm.decode(app.data.grains.centers), app.data.grains.diameters && gm.decode(app.data.grains.diameters),
      values(app, index, row, ["residual", "iterations"]),
    ]);
    const decimals = app.data.length_decimals, center = [...centers.subarray(3 * row, 3 * row + 3)];
    const rows = [["Centre in the reference", `${center.map((c) => gm.fixed(c, decimals)).join(", ")} mm`]];
    if (diameters && Number.isFinite(diameters[row])) rows.push(["Diameter of a ball of its volume", `${gm.significant(diameters[row], 4)} mm`]);
    rows.push(["Residual behind it, root mean square", gm.significant(residual)], ["Iterations", gm.fixed(iterations, 0)]);
    if (app.quantity("exx")) {
      const strains = await values(app, index, row, ["volume_strain", "exx", "eyy", "ezz", "eyz", "exz", "exy"]);
      if (strains.some(Number.isFinite)) {
        rows.push(["Volumetric strain", gm.fixed(strains[0], 4)], ["Strain xx, yy, zz", strains.slice(1, 4).map((e) => gm.fixed(e, 4)).join(", ")],
          ["Strain yz, xz, xy", strains.slice(4).map((e) => gm.fixed(e, 4)).join(", ")]);
      }
    }
    return el("dl", { class: "facts" }, rows.map(([name, value]) => el("div", {}, el("dt", {}, name), el("dd", {}, value))));
  };

  const choose = (app) => {
    const input = el("input", { type: "text", inputmode: "numeric", "aria-label": "Label of a grain", placeholder: "Label of a grain" });
    const told = el("p", { class: "quiet", role: "status" });
    const submit = (event) => {
      event.preventDefault();
      const label = Number(input.value.trim());
      if (input.value.trim() && app.row(label) >= 0) app.setGrain(label);
      else told.textContent = `There is no grain ${input.value.trim()}.`;
    };
    return el("form", { onsubmit: submit }, el("div", { class: "choose" }, input, el("button", { class: "button" }, "Show")), told);
  };

  const head = (app, record) => {
    const { labels } = app.data.grains, row = app.row(app.grain);
    const step = (by, sign, name) => el("button", {
      type: "button", class: "button icon", "aria-label": name, title: name, disabled: !labels[row + by], onclick: () => app.setGrain(labels[row + by]),
    }, sign);
    return el("div", { class: "panel-head" }, el("h3", {}, `Grain ${app.grain}`),
      record ? el("span", { class: "chip", style: `--dot: ${record.colour}`, title: record.meaning }, el("span", { class: "dot" }), record.name) : null,
      el("span", { class: "steps" }, step(-1, "‹", "Previous grain"), step(1, "›", "Next grain"),
        el("button", { type: "button", class: "button icon", "aria-label": "Choose no grain", title: "Choose no grain", onclick: () => app.setGrain(null) }, "×")));
  };

  const chosen = async (app, index, row) => {
    if (index < 0) return [head(app, null), el("p", { class: "quiet" }, "There is no later state yet.")];
    const [status, reasons] = await Promise.all([app.status(index), app.reasons(index)]);
    const record = app.data.statuses[status[row]];
    if (!record) return [head(app, null), el("p", {}, "This state does not have the grain.")];
    const reason = reasons[row] || (record.name === "converged" ? "" : record.meaning);
    const [motion, sentences, more] = await Promise.all([
      motionTable(app, index, row), weakSentences(app, index, row), facts(app, index, row),
    ]);
    return [head(app, record), reason ? el("p", { class: "panel-reason", style: `--dot: ${record.colour}` }, reason) : null,
      motion, sentences ? [el("h4", {}, "Weak directions"), sentences] : null, el("h4", {}, "More"), more];
  };

  gm.panel = {
    mount(place, app) {
      const show = async () => {
        const { grain, state } = app;
        const content = grain === null
          ? [el("h3", { style: "margin: 0" }, "Choose a grain"), el("p", { class: "quiet" },
            "Click a grain in the picture or a row of the table, or type its label: its motion, its reason and its shadows appear here."), choose(app)]
          : await chosen(app, state, app.row(grain));
        if (grain === app.grain && state === app.state) gm.refill(place, content.flat(3).filter(Boolean));
      };
      app.on("grain", show);
      app.on("state", show);
      show();
    },
  };
})();
