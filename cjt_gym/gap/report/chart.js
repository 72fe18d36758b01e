// Zoom and read-out of the charts in a group that shares its horizontal axis.
"use strict";
(() => {
  const SIZE = 10000;
  const groups = new Map();
  for (const figure of document.querySelectorAll("figure[data-zoom]")) {
    const [low, high] = figure.dataset.x.split(" ").map(Number);
    const [bottom, top] = figure.dataset.y.split(" ").map(Number);
    const curves = [...figure.querySelectorAll("path.line")].map((path) => {
      const values = path.getAttribute("d").slice(1).split(" ").map(Number);
      return { x: values.filter((_, k) => k % 2 === 0), y: values.filter((_, k) => k % 2 === 1) };
    });
    const chart = { figure, low, high, bottom, top, curves, svg: figure.querySelector("svg"), area: figure.querySelector(".area") };
    if (!groups.has(figure.dataset.zoom)) groups.set(figure.dataset.zoom, []);
    groups.get(figure.dataset.zoom).push(chart);
  }

  const ticks = (low, high) => {
    const raw = (high - low) / 6, power = 10 ** Math.floor(Math.log10(raw));
    const step = [1, 2, 5, 10].map((f) => f * power).find((s) => s >= raw * (1 - 1e-9));
    const decimals = Math.max(-Math.floor(Math.log10(step) + 1e-9), 0);
    const found = [];
    for (let k = Math.ceil(low / step - 1e-9); k * step <= high + 1e-9 * step; k++)
      found.push([k * step, (k * step + 0).toFixed(decimals).replace("-", "\u2212")]);
    return found;
  };

  // `from` and `to` are shares of the whole axis, 0 to 1.
  const show = (chart, from, to) => {
    const left = from * SIZE, right = to * SIZE;
    let above = SIZE, below = 0;
    for (const { x, y } of chart.curves)
      x.forEach((at, k) => {
        if (at >= left && at <= right) { above = Math.min(above, y[k]); below = Math.max(below, y[k]); }
      });
    const room = Math.max(0.06 * (below - above), 1);
    [above, below] = from === 0 && to === 1 ? [0, SIZE] : [above - room, below + room];
    chart.svg.setAttribute("viewBox", `${left} ${above} ${right - left} ${below - above}`);
    const span = chart.high - chart.low, height = chart.top - chart.bottom;
    const xs = ticks(chart.low + from * span, chart.low + to * span);
    const ys = ticks(chart.top - (below / SIZE) * height, chart.top - (above / SIZE) * height);
    const across = (v) => ((v - chart.low) / span) * SIZE, along = (v) => ((chart.top - v) / height) * SIZE;
    const label = (box, items, side, share) => box.replaceChildren(...items.map(([v, text]) => {
      const span = document.createElement("span");
      span.textContent = text;
      span.style[side] = `${100 * share(v)}%`;
      return span;
    }));
    label(chart.figure.querySelector(".x-ticks"), xs, "left", (v) => (across(v) - left) / (right - left));
    label(chart.figure.querySelector(".y-ticks"), ys, "bottom", (v) => (below - along(v)) / (below - above));
    chart.figure.querySelector(".grid").setAttribute("d",
      xs.map(([v]) => `M${across(v)} ${above}V${below}`).join("") + ys.map(([v]) => `M${left} ${along(v)}H${right}`).join(""));
  };

  const read = (chart, at) => {
    const outputs = chart.figure.querySelectorAll("output");
    chart.curves.forEach(({ x, y }, k) => {
      let low = 0, high = x.length - 1;
      while (low < high) { const middle = (low + high) >> 1; if (x[middle] < at) low = middle + 1; else high = middle; }
      const value = chart.top - (y[low] / SIZE) * (chart.top - chart.bottom);
      if (outputs[k]) outputs[k].textContent = at === null ? "" : value.toPrecision(4).replace("-", "\u2212");
    });
  };

  for (const charts of groups.values()) {
    let from = 0, to = 1;
    const view = (a, b) => {
      const width = Math.min(Math.max(b - a, 1e-3), 1);
      from = Math.min(Math.max(a, 0), 1 - width);
      to = from + width;
      charts.forEach((chart) => show(chart, from, to));
    };
    const tools = document.createElement("div");
    tools.className = "tools";
    for (const [text, label, act] of [
      ["\u2212", "Zoom out", () => view(from - (to - from) / 2, to + (to - from) / 2)],
      ["+", "Zoom in", () => view(from + (to - from) / 4, to - (to - from) / 4)],
      ["\u25c0", "Earlier", () => view(from - (to - from) / 3, to - (to - from) / 3)],
      ["\u25b6", "Later", () => view(from + (to - from) / 3, to + (to - from) / 3)],
      ["all", "Show all", () => view(0, 1)],
    ]) {
      const button = document.createElement("button");
      Object.assign(button, { type: "button", textContent: text, title: label, onclick: act });
      button.setAttribute("aria-label", label);
      tools.append(button);
    }
    charts[0].figure.prepend(tools);
    for (const chart of charts) {
      const { area } = chart;
      const brush = document.createElement("i"), cursor = document.createElement("i");
      brush.className = "brush";
      cursor.className = "cursor";
      brush.hidden = cursor.hidden = true;
      area.append(brush, cursor);
      let start = null;
      const share = (event) => {
        const box = area.getBoundingClientRect();
        return Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1);
      };
      area.addEventListener("pointerdown", (event) => { start = share(event); area.setPointerCapture(event.pointerId); });
      area.addEventListener("pointermove", (event) => {
        const now = share(event);
        cursor.hidden = false;
        cursor.style.left = `${100 * now}%`;
        read(chart, (from + now * (to - from)) * SIZE);
        if (start === null) return;
        brush.hidden = false;
        brush.style.left = `${100 * Math.min(start, now)}%`;
        brush.style.width = `${100 * Math.abs(now - start)}%`;
      });
      area.addEventListener("pointerup", (event) => {
        const ends = [start ?? 0, share(event)].sort((a, b) => a - b);
        if (start !== null && ends[1] - ends[0] > 0.01) view(from + ends[0] * (to - from), from + ends[1] * (to - from));
        start = null;
        brush.hidden = true;
      });
      area.addEventListener("pointercancel", () => { start = null; brush.hidden = true; });
      area.addEventListener("pointerleave", () => { cursor.hidden = true; read(chart, null); });
      area.addEventListener("dblclick", () => view(0, 1));
    }
  }
})();
