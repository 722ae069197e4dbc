"use strict";
// Which grains the table shows, in which order, and their rows as CSV.
(() => {
  const gm = (window.gm ??= {});

  /** Rows of the grains of a state that pass the filter: `statuses` a set of indices (empty: all), `text` a search. */
  gm.filteredRows = ({ app, status, reasons, statuses, text, needLook }) => {
    const plain = (sentence) => sentence.toLowerCase().replaceAll("-", " "); // "not fitted" finds not-fitted
    const words = plain(text.trim()), test = gm.labelTest(text);
    const { labels } = app.data.grains;
    const rows = [];
    for (let row = 0; row < labels.length; row++) {
      if (status[row] === 255 || (statuses.size && !statuses.has(status[row]))) continue;
      const name = app.data.statuses[status[row]].name;
      if (needLook && name === "converged") continue;
      if (words && !(test ? test(labels[row]) : plain(`${name} ${reasons[row] ?? ""}`).includes(words))) continue;
      rows.push(row);
    }
    return rows;
  };

  /** Sorts rows by a column; what has no value goes last either way. */
  gm.sortRows = (rows, value, ascending) => {
    const sign = ascending ? 1 : -1;
    return rows.sort((a, b) => {
      const x = value(a), y = value(b), lostX = Number.isNaN(x), lostY = Number.isNaN(y);
      if (lostX || lostY) return lostX - lostY || a - b;
      if (typeof x === "string") return sign * x.localeCompare(y) || a - b;
      return sign * (x - y) || a - b;
    });
  };

  const csvText = (text) => {
    const plain = text.replaceAll("#", "no. ").replace(/\s+/g, " ").replace(/^[=+\-@ ]+/, ""); // no formula, no comment
    return /[",]/.test(plain) ? `"${plain.replaceAll('"', '""')}"` : plain;
  };

  /** The columns of motions.csv for these rows of the state; mm and degrees, as many digits as the page holds (report/series_coding.py). */
  gm.csv = async (app, index, rows) => {
    const stored = app.data.states[index].columns;
    const motion = stored.filter((name) => !/^(sd_)?e[xyz]{2}$/.test(name)), strain = stored.filter((name) => !motion.includes(name));
    const read = async (names) => Promise.all(names.map((name) => app.column(index, name)));
    const [a, b, status, reasons, okU, okW, centers] = await Promise.all([
      read(motion), read(strain), app.status(index), app.reasons(index), app.ok(index, "translation"), app.ok(index, "rotation"), gm.decode(app.data.grains.centers),
    ]);
    const number = (value, digits = 7) => (Number.isNaN(value) ? "" : String(Number(value.toPrecision(digits))));
    const digitsOf = (name) => (name.startsWith("sd_") ? 4 : name === "residual" ? 5 : 7);
    const cells = (names, columns, row) => names.map((name, k) => number(columns[k][row], digitsOf(name)));
    const head = ["label", "status", "x", "y", "z", ...motion, "reason", "ok_translation", "ok_rotation", ...strain];
    const lines = rows.map((row) => [
      app.data.grains.labels[row], app.data.statuses[status[row]].name, ...[0, 1, 2].map((k) => number(centers[3 * row + k])),
      ...cells(motion, a, row), csvText(reasons[row] ?? ""), okU[row] ? "True" : "False", okW[row] ? "True" : "False",
      ...cells(strain, b, row),
    ].join(","));
    return `${[head.join(","), ...lines].join("\n")}\n`;
  };

  /** Save a text as a file. */
  gm.download = (name, text) => {
    const address = URL.createObjectURL(new Blob([text], { type: "text/csv" }));
    const link = gm.el("a", { href: address, download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(address), 10_000);
  };
})();
