"use strict";
// What pages of cells share: one cell walks; where another is chosen, it walks on from the same phase of the stride.
const { lines, cells } = scene;
const CHANGE = 0.3; // s in which the pose goes over to that of another cell, while it plays
let cell = scene.start;
let line = lineOf(cell);
let tellCell = () => {}; // what a page says of the cell that was just chosen
let drawWalks = () => {}; // how a page draws its walkers
let clock = () => 0; // where the charts over time are, s

function lineOf(number) {
  return lines.find((each) => each.cells.includes(number));
}

// A walker of each cell, recorded over a few strides that begin anew after the last one.
class Walk {
  constructor(prefix = "") {
    this.prefix = prefix; // of its name among the walkers, before the number of a cell
    this.phase = 0; // strides since the start
    this.gone = 0; // m
    this.offset = null; // of the pose from that of this cell when it was chosen, m
    this.arrived = 1; // share of the way to this cell's pose
  }

  get walker() { return walkers[this.prefix + cell]; }

  // First and last step of the stride that plays.
  get stride() {
    const { strides } = this.walker;
    return strides.slice(Math.floor(this.phase % (strides.length - 1))).slice(0, 2);
  }

  // Where the clock of the recorded stretch is at the phase, s.
  get seconds() {
    const [start, stop] = this.stride;
    return scene.dt * (start + (this.phase % 1) * (stop - start));
  }

  get recorded() { return poseAt(this.walker, this.seconds); }

  // How far it has gone at the phase, whole stretches before this one among it, in m.
  get distance() {
    const { strides, steps, x } = this.walker;
    return Math.floor(this.phase / (strides.length - 1)) * x[steps - 1] + this.recorded.x;
  }

  // The pose at the phase; just after a change, on the way to it from what was drawn then.
  get pose() {
    const pose = this.recorded;
    return this.arrived < 1 ? { ...pose, points: pose.points.map((value, i) => value + (1 - this.arrived) * this.offset[i]) } : pose;
  }

  advance(seconds) {
    this.arrived = Math.min(1, this.arrived + seconds / CHANGE);
    if (!this.walker) return;
    const [[start, stop], before] = [this.stride, this.distance];
    this.phase += seconds / (scene.dt * (stop - start));
    this.gone += this.distance - before;
  }

  // Begin to go over from what was drawn, a pose's points or null, to the cell that is chosen now.
  change(drawn) {
    this.arrived = drawn && this.walker ? 0 : 1;
    if (!this.arrived) this.offset = this.recorded.points.map((value, i) => drawn[i] - value);
  }
}

let walks = [new Walk()]; // the first one leads

advance = (seconds) => {
  for (const walk of walks) walk.advance(seconds);
  show();
};

// What a page shows of the moment: its walkers on the ground, or why there is none.
function show() {
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (!width || !height) return;
  const context = fitted(canvas, width, height);
  context.font = "11px system-ui, sans-serif";
  drawWalks(context, width, height);
  if (!walks.some((walk) => walk.walker)) {
    context.font = "15px system-ui, sans-serif";
    context.textAlign = "center";
    context.fillText("no steady stretch to play", width / 2, height / 2);
    context.textAlign = "start";
  }
  placeCursors(clock());
}

// A ring at the cell of a chart over what is asked for, a dot at the moment of a footfall diagram.
pointAt = (name, follows) => {
  if (name === "cell") return follows.y[cell] === null ? null : [cells[cell].asked, follows.y[cell]];
  const [walk] = walks;
  return walk.walker && cell in follows.rows ? [walk.seconds, follows.rows[cell]] : null;
};

function choose(number) {
  const drawn = walks.map((walk) => (playing && walk.walker ? walk.pose.points : null));
  cell = number;
  walks.forEach((walk, i) => walk.change(drawn[i]));
  line = lineOf(cell);
  byId("cells").max = line.cells.length - 1;
  byId("cells").value = line.cells.indexOf(cell);
  byId("cells").setAttribute("aria-valuetext", cells[cell].goal);
  byId("asked").textContent = cells[cell].goal;
  if (byId("gait")) byId("gait").value = line.gait;
  tellCell(cells[cell]);
  lines.forEach((each, i) => { showFootfall(`footfall-${i}`, each === line); });
  show();
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

// The controls of every page of cells; keys: those of its own.
function startCells(keys = {}) {
  byId("cells").addEventListener("input", (event) => choose(line.cells[Number(event.target.value)]));
  byId("gait")?.addEventListener("change", (event) => changeLine(event.target.value, line.share));
  byId("slower").addEventListener("click", () => changeSpeed(-1));
  byId("faster").addEventListener("click", () => changeSpeed(1));
  pick = ({ customdata }) => { if (customdata !== undefined) choose(customdata); };
  choose(cell);
  startPlayer({ ArrowLeft: () => changeSpeed(-1), ArrowRight: () => changeSpeed(1), ...keys }, show);
}
