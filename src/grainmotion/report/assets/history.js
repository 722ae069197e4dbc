"use strict";
// The motion of the chosen grain over all states, with a band of one standard deviation; a gap where it is no result to use.
(() => {
  const gm = (window.gm ??= {});
  const { el } = gm;
  const LINES = [["u", "Translation", "mm"], ["w", "Rotation vector", "degrees"]];

  const chart = async (app, row, [letter, title, unit]) => {
    const { states, state_numbers: numbers } = app.data;
    const line = (key) => Promise.all(states.map(async (_, i) => (await app.usable(i, key))[row]));
    const series = await Promise.all([..."xyz"].map(async (a) => ({ name: a, values: await line(letter + a), sd: await line(`sd_${letter}${a}`) })));
    return [el("h4", {}, `${title} (${unit})`), gm.chart({
      title: `${title} of grain ${app.grain} over states`, series, x: numbers, xTitle: "state", yTitle: unit, height: 180,
      now: numbers[app.state], ticks: numbers.map((number) => [number, String(number)]), hints: states.map(({ name }) => name), onpick: app.setState,
    })];
  };

  gm.history = {
    mount(place, app) {
      const whole = document.getElementById("chosen"), single = app.data.states.length < 2;
      whole.classList.toggle("single", single);
      place.hidden = single;
      const show = async () => {
        whole.hidden = app.grain === null;
        if (single || app.grain === null) return;
        const { grain, state } = app, charts = await Promise.all(LINES.map((line) => chart(app, app.row(grain), line)));
        if (grain === app.grain && state === app.state) place.replaceChildren(el("h3", {}, "Its motion over all states"), ...charts.flat());
      };
      app.on("grain", show);
      app.on("state", show);
      show();
    },
  };
})();
