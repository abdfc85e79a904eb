"use strict";
// Plotly's charts, drawn when they come into view, and a cursor over each that follows the player.
const charts = new Map();
const visible = new Set();
let goTo = () => {}; // what a click at a time does
let pick = () => {}; // what a click on a point does
let pointAt = () => null; // where a dot is: its name, what it follows, the time -> [x, y]

function themed() {
  const axis = { gridcolor: colour("--rule"), linecolor: colour("--faint"), tickcolor: colour("--faint") };
  return {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
    font: { color: colour("--ink"), size: 12, family: "system-ui, DejaVu Sans, sans-serif" },
    hoverlabel: { bgcolor: colour("--panel"), font: { color: colour("--ink") } }, axis,
  };
}

function themedLayout(layout) {
  const { axis, ...rest } = themed();
  return { ...layout, ...rest, xaxis: { ...layout.xaxis, ...axis }, yaxis: { ...layout.yaxis, ...axis } };
}

function drawChart(chart) {
  const touch = window.matchMedia("(pointer: coarse)").matches;
  const layout = { ...themedLayout(chart.figure.layout), dragmode: touch ? false : "zoom", hovermode: "closest", autosize: true };
  const config = { responsive: true, displayModeBar: false, scrollZoom: false };
  chart.drawn = true;
  Plotly.newPlot(chart.plot, chart.figure.data, layout, config).then(() => {
    chart.cursors = cursorsOf(chart);
    chart.plot.on("plotly_afterplot", () => placeCursor(chart, lastTime));
    if (chart.cursor === "time") chart.plot.addEventListener("click", (event) => goToPixel(chart.plot, event.clientX));
    chart.plot.on("plotly_click", ({ points }) => pick(points[0]));
    placeCursor(chart, lastTime);
  });
}

function cursorsOf(chart) {
  if (!chart.cursor) return [];
  const names = chart.cursor === "time" ? [""] : Object.keys(chart.cursor);
  return names.map((name) => {
    const element = document.createElement("div");
    element.className = name ? `cursor dot ${name}` : "cursor line";
    chart.plot.append(element);
    return { name, element };
  });
}

// From a value on an axis to a pixel of the plot; margins and ranges are the layout's own.
function frame(plot) {
  const { margin, xaxis, yaxis } = plot.layout;
  const [width, height] = [plot.clientWidth - margin.l - margin.r, plot.clientHeight - margin.t - margin.b];
  return {
    top: margin.t, height,
    inside: (x, y) => x >= xaxis.range[0] && x <= xaxis.range[1] && (y === null || (y >= yaxis.range[0] && y <= yaxis.range[1])),
    x: (value) => margin.l + (width * (value - xaxis.range[0])) / (xaxis.range[1] - xaxis.range[0]),
    y: (value) => margin.t + height * (1 - (value - yaxis.range[0]) / (yaxis.range[1] - yaxis.range[0])),
  };
}

function goToPixel(plot, x) {
  const { margin, xaxis } = plot.layout;
  const share = (x - plot.getBoundingClientRect().left - margin.l) / (plot.clientWidth - margin.l - margin.r);
  if (share >= 0 && share <= 1) goTo(xaxis.range[0] + share * (xaxis.range[1] - xaxis.range[0]));
}

let lastTime = 0;

function placeCursor(chart, time) {
  if (!chart.cursors || !chart.cursors.length) return;
  const box = frame(chart.plot);
  for (const { name, element } of chart.cursors) {
    const point = name ? pointAt(name, chart.cursor[name], time) : [time, null];
    const there = point !== null && box.inside(point[0], point[1]);
    element.style.display = there ? "block" : "none";
    if (!there) continue;
    if (!name) element.style.height = `${box.height}px`;
    element.style.transform = `translate(${box.x(point[0])}px, ${name ? box.y(point[1]) : box.top}px)`;
  }
}

function placeCursors(time) {
  lastTime = time;
  for (const chart of visible) placeCursor(chart, time);
}

function startCharts() {
  const watch = new IntersectionObserver((entries) => {
    for (const { target, isIntersecting } of entries) {
      const chart = charts.get(target.id);
      if (!isIntersecting) { visible.delete(chart); continue; }
      visible.add(chart);
      if (!chart.drawn) drawChart(chart);
      else placeCursor(chart, lastTime);
    }
  }, { rootMargin: "200px" });
  for (const chart of page.charts) {
    const figure = document.getElementById(chart.key);
    charts.set(chart.key, { ...chart, plot: figure.querySelector(".plot") });
    watch.observe(figure);
  }
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
    for (const chart of charts.values()) if (chart.drawn) Plotly.relayout(chart.plot, themedLayout(chart.plot.layout));
  });
}
