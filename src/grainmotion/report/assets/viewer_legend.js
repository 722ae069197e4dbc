"use strict";
// The colour bar with its range, which can be edited, and the picture of it for saved images.
(() => {
  const gm = (window.gm ??= {});
  const { el } = gm;

  const mapName = (quantity) => gm.colours.DEFAULTS[quantity.kind] ?? null;

  /** A number for people to edit: short. */
  const editable = (value) => String(Number(value.toPrecision(4))).replaceAll("-", "−");

  /** The legend: { element, update(quantity, range, isOwn, lacking) }; `changed(range)` gets [low, high], or null for automatic. */
  const create = (changed) => {
    const title = el("div", { class: "viewer-legend-title" }), bar = el("div", { class: "viewer-legend-bar" });
    const field = (label) => el("input", { type: "text", inputmode: "decimal", "aria-label": label, onchange: (event) => edited(event.target) });
    const low = field("Lowest value of the colours"), high = field("Highest value of the colours");
    const automatic = el("button", { type: "button", class: "link", onclick: () => changed(null) }, "automatic range");
    const note = el("div", { class: "quiet" });
    const element = el("div", { class: "viewer-legend" }, title, bar, el("div", { class: "viewer-legend-ends" }, low, high), automatic, note);
    let shown = [0, 1];
    const edited = (input) => {
      const range = [low, high].map(({ value }) => (value.trim() ? Number(value.replaceAll("−", "-").replace(",", ".")) : NaN));
      if (!range.every(Number.isFinite)) {
        [low.value, high.value] = shown.map(editable);
        return;
      }
      const width = shown[1] - shown[0]; // the other end gives way to the one that was edited
      if (range[0] >= range[1]) range[input === low ? 1 : 0] = input === low ? range[0] + width : range[1] - width;
      changed(range);
    };
    const update = (quantity, range, isOwn, lacking) => {
      const name = mapName(quantity);
      title.textContent = quantity.title + (quantity.unit ? ` (${quantity.unit})` : "");
      for (const part of [bar, low, high]) part.hidden = name === null;
      automatic.hidden = !isOwn;
      note.textContent = name === null ? "Colours are those of the buttons below."
        : [quantity.note, lacking ? "Grey: no result to use." : ""].filter(Boolean).join(" ");
      if (name === null) return;
      shown = range;
      bar.style.background = gm.colours.gradient(name);
      [low.value, high.value] = range.map(editable);
    };
    return { element, update };
  };

  /** Draw title, colour bar and range at the lower left of an image. */
  const paint = (context, height, quantity, range, ink) => {
    const name = mapName(quantity), unit = Math.max(12, Math.round(height / 50)), x = unit, width = 14 * unit;
    context.fillStyle = ink;
    context.font = `600 ${unit}px system-ui, sans-serif`;
    context.fillText(quantity.title + (quantity.unit ? ` (${quantity.unit})` : ""), x, height - 3.9 * unit);
    if (name === null) return;
    const colour = gm.colours.map(name);
    for (let i = 0; i < width; i++) {
      context.fillStyle = gm.colours.css(colour(i / (width - 1)));
      context.fillRect(x + i, height - 3.4 * unit, 1, unit);
    }
    context.fillStyle = ink;
    context.font = `${unit}px system-ui, sans-serif`;
    context.fillText(gm.significant(range[0]), x, height - unit);
    context.textAlign = "right";
    context.fillText(gm.significant(range[1]), x + width, height - unit);
    context.textAlign = "left";
  };

  gm.viewerLegend = { create, paint, mapName };
})();
