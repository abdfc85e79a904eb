"use strict";
// The library's player: one cell walks; where another is chosen, that one walks on from the same phase of the stride.
const { lines, cells } = scene;
let line = lines.find((each) => each.cells.includes(scene.start));
let cell = scene.start;
let phase = 0; // strides since the start
let gone = 0; // m
const CHANGE = 0.3; // s in which the pose goes over to that of another cell, while it plays
let offset = null; // of the pose from that of this cell when it was chosen, m
let arrived = 1; // share of the way to this cell's pose
const fields = [...document.querySelectorAll("[data-measure]")];

// Where the clock of a recorded stretch is at the phase, which begins anew after its last stride, in s.
function secondsAt(walker) {
  const at = phase % (walker.strides.length - 1);
  const [start, stop] = walker.strides.slice(Math.floor(at));
  return scene.dt * (start + (at % 1) * (stop - start));
}

// How far a walker has gone at the phase, whole stretches before this one among it, in m.
function distanceOf(walker) {
  const stretches = Math.floor(phase / (walker.strides.length - 1));
  return stretches * walker.x[walker.steps - 1] + poseAt(walker, secondsAt(walker)).x;
}

// The pose at the phase; just after a change, on the way to it from what was drawn then.
function poseNow(walker) {
  const pose = poseAt(walker, secondsAt(walker));
  return arrived < 1 ? { ...pose, points: pose.points.map((value, i) => value + (1 - arrived) * offset[i]) } : pose;
}

advance = (seconds) => {
  const walker = walkers[cell];
  arrived = Math.min(1, arrived + seconds / CHANGE);
  if (walker) {
    const [start, stop] = walker.strides.slice(Math.floor(phase % (walker.strides.length - 1)));
    const before = distanceOf(walker);
    phase += seconds / (scene.dt * (stop - start));
    gone += distanceOf(walker) - before;
  }
  show();
};

function show() {
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (!width || !height) return;
  const [context, walker] = [fitted(canvas, width, height), walkers[cell]];
  const scale = Math.min((height - 46) / scene.top, width / 1.8);
  const view = { scale, x: (x) => width / 2 + scale * x, y: (y) => height - 30 - scale * y };
  context.font = "11px system-ui, sans-serif";
  drawGround(context, view, gone, width);
  if (walker) {
    drawModel(context, poseNow(walker), view, line.color);
  } else {
    context.font = "15px system-ui, sans-serif";
    context.textAlign = "center";
    context.fillText("no steady stretch to play", width / 2, height / 2);
    context.textAlign = "start";
  }
  placeCursors(0);
}

// A ring at the cell of an atlas chart, a dot at the moment of a footfall diagram.
pointAt = (name, follows) => {
  if (name === "cell") return follows.y[cell] === null ? null : [cells[cell].asked, follows.y[cell]];
  const walker = walkers[cell];
  return walker && cell in follows.rows ? [secondsAt(walker), follows.rows[cell]] : null;
};

function choose(number) {
  const drawn = playing && walkers[cell] ? poseNow(walkers[cell]).points : null;
  cell = number;
  arrived = drawn && walkers[cell] ? 0 : 1;
  if (!arrived) offset = poseAt(walkers[cell], secondsAt(walkers[cell])).points.map((value, i) => drawn[i] - value);
  line = lines.find((each) => each.cells.includes(cell));
  const { goal, fit, said, numbers } = cells[cell];
  scene.foot_radius = cells[cell].foot_radius;
  scene.roll_over_radius = cells[cell].roll_over_radius;
  const rank = line.cells.indexOf(cell);
  byId("cells").max = line.cells.length - 1;
  byId("cells").value = rank;
  byId("cells").setAttribute("aria-valuetext", goal);
  byId("asked").textContent = goal;
  byId("verdict").textContent = fit ? `Fit to be imitated: ${said}.` : `Refused: ${said}.`;
  byId("verdict").className = fit ? "" : "refused";
  fields.forEach((field, i) => { field.textContent = numbers[i]; });
  offerLines();
  lines.forEach((each, i) => { showFootfall(`footfall-${i}`, each === line); });
  show();
}

function offerLines() {
  const shares = lines.filter((each) => each.gait === line.gait).map((each) => each.share);
  byId("share").replaceChildren(...shares.map((share) => new Option(`× ${share}`, share, false, share === line.share)));
  if (byId("gait")) byId("gait").value = line.gait;
}

function showFootfall(key, on) {
  const chart = charts.get(key);
  const figure = byId(key);
  const hidden = figure.hidden;
  figure.hidden = !on;
  if (on && hidden && chart?.drawn) Plotly.Plots.resize(chart.plot);
}

// The cell of another line whose goal is nearest to this one.
function changeLine(gait, share) {
  const own = lines.filter((each) => each.gait === gait);
  const next = own.find((each) => each.share === share) || own[0];
  const off = (number) => Math.abs(cells[number].asked - cells[cell].asked);
  choose(next.cells.reduce((best, number) => (off(number) < off(best) ? number : best)));
}

function changeSpeed(by) {
  const rank = line.cells.indexOf(cell) + by;
  choose(line.cells[Math.min(Math.max(rank, 0), line.cells.length - 1)]);
}

byId("cells").addEventListener("input", (event) => choose(line.cells[Number(event.target.value)]));
byId("share").addEventListener("change", (event) => changeLine(line.gait, Number(event.target.value)));
byId("gait")?.addEventListener("change", (event) => changeLine(event.target.value, line.share));
byId("slower").addEventListener("click", () => changeSpeed(-1));
byId("faster").addEventListener("click", () => changeSpeed(1));
pick = ({ customdata }) => { if (customdata !== undefined) choose(customdata); };
choose(cell);
startPlayer({ ArrowLeft: () => changeSpeed(-1), ArrowRight: () => changeSpeed(1) }, show);
