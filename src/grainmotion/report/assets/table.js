"use strict";
// The table of grains of a state.  Only the rows in sight are elements, so that thousands of grains stay fluid.
(() => {
  const gm = (window.gm ??= {});
  const { el } = gm;
  const ROW = 32; // pixels, as in table.css
  const AHEAD = 14; // rows beyond those in sight
  const PRINTED = 500; // rows on paper
  const SETS = [
    { name: "components", title: "Components", on: true },
    { name: "deviations", title: "All standard deviations", on: false },
    { name: "place", title: "Places", on: false },
    { name: "strain", title: "Components of strain", on: false },
    { name: "reason", title: "Reasons", on: false },
  ];

  const PADDING = 13; // of a cell, left and right together, pixels
  let digit = 8; // width of a digit in the table's type, pixels

  const measureDigit = (element) => {
    const context = document.createElement("canvas").getContext("2d"), { fontSize, fontFamily } = getComputedStyle(element);
    context.font = `${0.83 * parseFloat(fontSize)}px ${fontFamily}`;
    return context.measureText("0").width;
  };

  /** Width in which the longest number of a column and its heading fit: a number that is cut off would mislead. */
  const widthOf = (head, column, text) => {
    let longest = head.length + 2; // and the arrow of the order
    for (let row = 0; row < column.length; row++) longest = Math.max(longest, text(row).length);
    return Math.ceil(PADDING + digit * longest);
  };

  /** Columns: key, heads of two rows, width in pixels, the set that shows it, and how a cell is made. */
  const columnsOf = (app, tables) => {
    const { labels } = app.data.grains, columns = [
      { key: "label", head: "Grain", group: "", width: 62, value: (row) => labels[row], text: (row) => String(labels[row]), class: "first" },
      { key: "status", head: "Status", group: "", width: 40 + 15 * digit, value: (row) => app.data.statuses[tables.status[row]].name, cell: (row) => statusCell(app, tables.status[row]), class: "text" },
    ];
    const add = (key, head, group, set, used = null) => {
      const quantity = app.quantity(key), column = tables.columns.get(key);
      const text = (row) => gm.quantityText(quantity, column[row], app.data.length_decimals);
      columns.push({ key, head, group, set, width: widthOf(head, column, text), title: quantity.title, value: (row) => column[row], text, used });
    };
    "xyz".split("").forEach((a, k) => columns.push({
      key: a, head: a, group: "Centre (mm)", set: "place", width: 14 + 9 * digit, value: (row) => tables.centers[3 * row + k],
      text: (row) => gm.fixed(tables.centers[3 * row + k], app.data.length_decimals),
    }));
    for (const [letter, group, head] of [["u", "Translation (mm)", "|u|"], ["w", "Rotation (°)", "|ω|"]]) {
      const ok = tables.ok[letter], used = (row) => ok[row];
      add(letter, head, group, null, used);
      for (const a of "xyz") add(letter + a, a, group, "components", used);
      add(`sd_${letter}`, "sd", group, null, used);
      for (const a of "xyz") add(`sd_${letter}${a}`, `sd ${a}`, group, "deviations", used);
      columns.push({ key: `ok_${letter}`, head: "use", group, width: 44, value: (row) => ok[row], text: (row) => (ok[row] ? "yes" : "no"), title: "Whether it is a result to use" });
    }
    add("residual", "residual", "Fit", null);
    add("iterations", "iterations", "Fit", "deviations");
    if (app.quantity("exx")) {
      add("volume_strain", "volume", "Strain", null);
      for (const name of ["exx", "eyy", "ezz", "eyz", "exz", "exy"]) add(name, name.slice(1), "Strain", "strain");
    }
    columns.push({ key: "reason", head: "Reason", group: "", set: "reason", width: 420, class: "text", value: (row) => tables.reasons[row] || NaN, text: (row) => tables.reasons[row] ?? "" });
    return columns;
  };

  const statusCell = (app, index) => {
    const { colour, name } = app.data.statuses[index];
    return el("span", { class: "status-name", style: `--dot: ${colour}` }, el("span", { class: "dot" }), name);
  };

  /** All columns of a state, ready to be read row by row. */
  const load = async (app, index) => {
    const keys = app.data.quantities.map(({ key }) => key).filter((key) => key !== "status");
    const [read, status, reasons, u, w, centers] = await Promise.all([
      Promise.all(keys.map((key) => app.column(index, key))), app.status(index), app.reasons(index),
      app.ok(index, "translation"), app.ok(index, "rotation"), gm.decode(app.data.grains.centers),
    ]);
    return { columns: new Map(keys.map((key, k) => [key, read[k]])), status, reasons, ok: { u, w }, centers };
  };

  const mount = (place, app) => {
    const shown = new Set(SETS.filter(({ on }) => on).map(({ name }) => name));
    const filter = { statuses: new Set(), text: "" }, order = { key: "label", ascending: true };
    let tables = null, columns = [], rows = [], whole = false;

    const search = el("input", { type: "search", placeholder: "Labels (12, 30-40), status or reason", "aria-label": "Search grains by label, status or reason", oninput: () => { filter.text = search.value; arrange(); } });
    const chips = el("fieldset", {}), sets = el("fieldset", {}), count = el("span", { class: "count quiet", role: "status" });
    const save = el("button", { type: "button", class: "button", onclick: async () => {
      const { name } = app.data.states[app.state];
      gm.download(`${name.replace(/[^\w.-]+/g, "_")}-grains.csv`, await gm.csv(app, app.state, rows));
    } }, "Download CSV");
    const head = el("thead"), body = el("tbody"), group = el("colgroup");
    const table = el("table", { "aria-label": "Grains" }, group, head, body);
    const port = el("div", { class: "grain-window card", tabindex: 0, role: "region", "aria-label": "Rows of the table", "aria-description": "Arrow keys choose the next grain", onscroll: () => fill() }, table);
    place.append(el("div", { class: "table-tools" }, search, chips), el("div", { class: "table-tools" }, sets, count, save), port);

    digit = measureDigit(port);
    const visible = () => columns.filter(({ set }) => !set || shown.has(set));

    const drawHead = () => {
      const list = visible(), groups = [];
      for (const column of list) {
        if (groups.length && groups.at(-1).name === column.group) groups.at(-1).span++;
        else groups.push({ name: column.group, span: 1 });
      }
      table.style.minWidth = `${list.reduce((sum, { width }) => sum + width, 0)}px`;
      group.replaceChildren(...list.map(({ width }) => el("col", { style: `width: ${width}px` })));
      gm.refill(head, [
        el("tr", { class: "groups" }, groups.map(({ name, span }) => el(name ? "th" : "td", { colspan: span, scope: name ? "colgroup" : null }, name))),
        el("tr", {}, list.map((column) => el("th", {
          scope: "col", class: column.class, "data-key": column.key, "aria-sort": order.key !== column.key ? "none" : order.ascending ? "ascending" : "descending",
          "data-head": column.head,
        }, el("button", { type: "button", title: column.title ?? column.head, "data-focus": column.key, onclick: () => {
          order.ascending = order.key === column.key ? !order.ascending : true;
          order.key = column.key;
          drawHead();
          arrange();
        } }, column.head)))),
      ], port);
    };

    const arrange = () => {
      rows = gm.filteredRows({ app, ...tables, ...filter });
      const column = columns.find(({ key }) => key === order.key);
      if (order.key !== "label" || !order.ascending) gm.sortRows(rows, column.value, order.ascending);
      const total = app.data.states[app.state].grains;
      count.textContent = rows.length === total ? `${total} grains` : `${rows.length} of ${total} grains`;
      table.setAttribute("aria-rowcount", String(rows.length + 2));
      fill(true);
    };

    const rowElement = (row, place_) => {
      const label = app.data.grains.labels[row];
      return el("tr", { "data-label": label, "aria-rowindex": place_ + 3, "aria-selected": String(label === app.grain), tabindex: -1, onclick: () => app.setGrain(label) },
        visible().map((column) => el("td", { class: column.used && !column.used(row) ? "unused" : column.class, title: column.key === "reason" ? column.text(row) : null }, column.cell ? column.cell(row) : column.text(row))));
    };

    let drawn = [0, -1];
    /** Draw the rows in sight and some beyond, where those in sight are not all there yet. */
    const fill = (anew = false) => {
      const top = Math.floor(port.scrollTop / ROW), bottom = Math.min(rows.length, Math.ceil((port.scrollTop + port.clientHeight) / ROW));
      if (!anew && top >= drawn[0] && bottom <= drawn[1]) return;
      const first = whole ? 0 : Math.max(0, top - AHEAD), last = Math.min(rows.length, whole ? PRINTED : bottom + AHEAD);
      drawn = [first, last];
      const space = (height) => (height > 0 ? el("tr", { class: "space", "aria-hidden": "true" }, el("td", { colspan: visible().length, style: `height: ${height}px` })) : null);
      const list = rows.slice(first, last).map((row, k) => rowElement(row, first + k));
      const more = whole && rows.length > last ? el("tr", { class: "space" }, el("td", { class: "nothing", colspan: visible().length }, `${rows.length - last} more grains are on the page and in motions.csv.`)) : null;
      const none = rows.length ? null : el("tr", { class: "space" }, el("td", { class: "nothing", colspan: visible().length, style: "line-height: 1.5; height: 3rem" }, "No grain passes the search and the filter."));
      body.replaceChildren(...[space(first * ROW), ...list, none, more, whole ? null : space((rows.length - last) * ROW)].filter(Boolean));
    };

    const reveal = () => {
      for (const element of body.querySelectorAll("[data-label]")) element.setAttribute("aria-selected", String(Number(element.dataset.label) === app.grain));
      const at = rows.indexOf(app.row(app.grain)), low = at * ROW, room = port.clientHeight - head.offsetHeight - ROW;
      if (app.grain !== null && at >= 0 && (low < port.scrollTop || low > port.scrollTop + room)) port.scrollTop = low - room / 2;
    };

    const toggle = (collection, item, text, onchange) => {
      const button = el("button", { type: "button", class: "chip", "aria-pressed": String(collection.has(item)), onclick: () => {
        if (!collection.delete(item)) collection.add(item);
        button.setAttribute("aria-pressed", String(collection.has(item)));
        onchange();
      } }, text);
      return button;
    };

    const drawChips = () => {
      const present = app.data.statuses.map((record, k) => [record, k, gm.count(tables.status, k)]).filter(([, k, n]) => n || filter.statuses.has(k));
      gm.refill(chips, [el("legend", {}, "Status"), ...present.map(([record, k, n]) => {
        const chip = toggle(filter.statuses, k, [el("span", { class: "dot" }), `${record.name} ${n}`], arrange);
        chip.style.setProperty("--dot", record.colour);
        return chip;
      })], search);
    };

    const show = async () => {
      const index = app.state, loaded = await load(app, index);
      if (index !== app.state) return;
      tables = loaded;
      columns = columnsOf(app, tables);
      const known = SETS.filter(({ name }) => columns.some(({ set }) => set === name));
      gm.refill(sets, [el("legend", {}, "Columns"), ...known.map(({ name, title }) => toggle(shown, name, title, () => { drawHead(); fill(true); }))], port);
      drawChips();
      drawHead();
      arrange();
    };

    port.addEventListener("keydown", (event) => {
      const by = { ArrowDown: 1, ArrowUp: -1 }[event.key];
      if (!by || !rows.length) return;
      event.preventDefault();
      const at = rows.indexOf(app.row(app.grain));
      app.setGrain(app.data.grains.labels[rows[Math.min(rows.length - 1, Math.max(0, at < 0 ? 0 : at + by))]]);
    });
    new ResizeObserver(() => tables && fill()).observe(port);
    app.on("grain", reveal);
    app.on("state", show);
    for (const [event, all] of [["beforeprint", true], ["afterprint", false]]) {
      window.addEventListener(event, () => { whole = all; if (tables) fill(true); });
    }
    show();
  };

  gm.table = { mount: (place, app) => app.state >= 0 && mount(place, app) };
})();
