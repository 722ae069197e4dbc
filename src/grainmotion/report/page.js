"use strict";

// Sort a table of grains by the column whose heading is clicked; what has no value goes last.
for (const head of document.querySelectorAll(".grains thead tr:last-child th")) {
  head.addEventListener("click", () => {
    const column = head.cellIndex, body = head.closest("table").tBodies[0];
    const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    const value = (row) => {
      const text = row.cells[column].textContent.trim();
      const number = Number(text.replace("−", "-"));
      return text === "" || text === "–" ? null : Number.isNaN(number) ? text : number;
    };
    const rows = Array.from(body.rows, (row) => [value(row), row]);
    rows.sort(([a], [b]) => {
      if (a === null || b === null) return (a === null) - (b === null);
      if (typeof a === "number" && typeof b === "number") return sign * (a - b);
      return sign * String(a).localeCompare(String(b));
    });
    body.append(...rows.map(([, row]) => row));
    for (const other of head.parentNode.cells) other.setAttribute("aria-sort", "none");
    head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
  });
}

// Enlarge the three images of a view.
const zoom = document.getElementById("zoom");
for (const view of document.querySelectorAll(".view")) {
  view.querySelector(".trio").addEventListener("click", () => {
    zoom.replaceChildren(view.cloneNode(true));
    zoom.showModal();
  });
}
zoom.addEventListener("click", () => zoom.close());

// Arrows in three dimensions; a still picture of them stands in on paper.
const plot = document.getElementById("arrows-plot");
if (plot) {
  const figures = JSON.parse(document.getElementById("arrows-data").textContent);
  const state = document.getElementById("arrows-state"), kind = document.getElementById("arrows-kind");
  const paper = document.getElementById("arrows-print");
  const dark = window.matchMedia("(prefers-color-scheme: dark)");
  const styled = (layout, ink, line) => {
    const clear = "rgba(0,0,0,0)", copy = structuredClone(layout);
    Object.assign(copy, { paper_bgcolor: clear, font: { color: ink, family: "Arial, sans-serif" } });
    copy.modebar = { bgcolor: clear, color: ink };
    for (const axis of ["xaxis", "yaxis", "zaxis"]) Object.assign(copy.scene[axis], { gridcolor: line, zerolinecolor: line });
    return copy;
  };
  const draw = async () => {
    const chosen = figures[state.selectedIndex];
    const { data: arrows, layout, note } = chosen.arrows[kind.value];
    const data = [...arrows, ...chosen.grains];
    const style = getComputedStyle(document.documentElement);
    const ink = style.getPropertyValue("--ink").trim(), line = style.getPropertyValue("--line").trim();
    document.getElementById("arrows-note").textContent = note + chosen.note;
    try {
      await Plotly.react(plot, data, styled(layout, ink, line), { responsive: true, displaylogo: false });
      const still = { data: structuredClone(data), layout: styled(layout, "#000", "#bbb") };
      paper.src = await Plotly.toImage(still, { format: "png", width: 1100, height: 640 });
    } catch (problem) {
      document.getElementById("arrows-note").textContent = "This browser cannot draw in 3-D: " + problem;
    }
  };
  for (const control of [state, kind, dark]) control.addEventListener("change", draw);
  draw();
}
