"use strict";
// What the pages share: recorded gaits (points in whole millimetres, forward of each walker's root), how the
// reduced-order model and the ground are drawn on the canvas, and the clock that moves them, with its keys.
const page = JSON.parse(document.getElementById("data").textContent);
const scene = page.scene;
const walkers = scene.walkers;
const byId = (id) => document.getElementById(id);
const canvas = byId("stage");
const PACES = [0.1, 0.25, 0.5, 1, 2];
const SOLE = Math.PI / 6; // half of the arc that a foot rolls on, as rom/drawing.py draws it
let playing = false;
let before = null;
let advance = () => {}; // what so many seconds of the clock do

for (const walker of Object.values(walkers)) {
  const bytes = Uint8Array.from(atob(walker.points), (letter) => letter.charCodeAt(0));
  walker.points = new Int16Array(bytes.buffer);
  walker.width = walker.points.length / walker.steps;
}

const colours = new Map(); // of the page's style, read once per scheme

function colour(name) {
  if (!colours.has(name)) colours.set(name, getComputedStyle(document.documentElement).getPropertyValue(name).trim());
  return colours.get(name);
}

window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => colours.clear());

// Points and x of a walker at a time, between two recorded steps; null where nothing was recorded.
function poseAt(walker, time) {
  const step = time / scene.dt - walker.offset;
  if (step < -1e-6 || step > walker.steps - 1 + 1e-6) return null;
  const first = Math.max(0, Math.min(Math.floor(step), walker.steps - 1));
  const next = Math.min(first + 1, walker.steps - 1);
  const share = step - first;
  const points = new Float32Array(walker.width);
  for (let i = 0; i < walker.width; i++) {
    const a = walker.points[first * walker.width + i];
    points[i] = (a + share * (walker.points[next * walker.width + i] - a)) / 1000;
  }
  return { points, x: walker.x[first] + share * (walker.x[next] - walker.x[first]), contact: walker.contact[first] };
}

function mixed(tone) {
  return `color-mix(in srgb, ${tone} 45%, ${colour("--panel")})`;
}

// The reduced-order model: a mass on two springs; a foot on the ground is filled.
function drawModel(context, pose, view, tone) {
  const [hipX, hipY] = [view.x(pose.points[0]), view.y(pose.points[1])];
  for (const foot of [1, 0]) {
    const [x, y] = [view.x(pose.points[2 + 2 * foot]), view.y(pose.points[3 + 2 * foot])];
    context.strokeStyle = context.fillStyle = foot ? mixed(tone) : tone;
    context.lineWidth = 2.5;
    spring(context, hipX, hipY, x, y, 0.03 * view.scale);
    if (scene.roll_over_radius) drawSole(context, hipX, hipY, x, y, view.scale);
    const ankle = scene.roll_over_radius ? 0.5 : 1; // above the sole
    context.beginPath();
    context.arc(x, y, ankle * scene.foot_radius * view.scale, 0, 2 * Math.PI);
    if (pose.contact[foot]) context.fill();
    context.stroke();
  }
  context.fillStyle = tone;
  context.beginPath();
  context.arc(hipX, hipY, 0.06 * view.scale, 0, 2 * Math.PI);
  context.fill();
}

// The arc that a foot rolls on, rigid with the leg, as far below the leg's end as it is high.
function drawSole(context, hipX, hipY, x, y, scale) {
  const length = Math.hypot(x - hipX, y - hipY) || 1;
  const above = ((scene.roll_over_radius - scene.foot_radius) * scale) / length;
  const down = Math.atan2(y - hipY, x - hipX);
  context.beginPath();
  context.arc(x - above * (x - hipX), y - above * (y - hipY), scene.roll_over_radius * scale, down - SOLE, down + SOLE);
  context.stroke();
}

function spring(context, x0, y0, x1, y1, amplitude) {
  const length = Math.hypot(x1 - x0, y1 - y0) || 1;
  const [acrossX, acrossY] = [((y0 - y1) / length) * amplitude, ((x1 - x0) / length) * amplitude];
  context.beginPath();
  context.moveTo(x0, y0);
  for (let turn = 0; turn <= 12; turn++) {
    const share = 0.2 + (0.6 * turn) / 12;
    const side = turn === 0 || turn === 12 ? 0 : turn % 2 ? 1 : -1;
    context.lineTo(x0 + share * (x1 - x0) + side * acrossX, y0 + share * (y1 - y0) + side * acrossY);
  }
  context.lineTo(x1, y1);
  context.stroke();
}

// A body as thick lines with round ends, in two passes: first all outlines, then all fillings.
function drawBody(context, pose, view, tone) {
  context.lineCap = "round";
  for (const far of [1, 0]) {
    for (const [grow, style] of [[2.5, colour("--panel")], [0, far ? mixed(tone) : tone]]) {
      context.strokeStyle = style;
      scene.segments.forEach(([radius, side], i) => {
        if (side !== far) return;
        context.lineWidth = 2 * radius * view.scale + grow;
        context.beginPath();
        context.moveTo(view.x(pose.points[4 * i]), view.y(pose.points[4 * i + 1]));
        context.lineTo(view.x(pose.points[4 * i + 2]) + 0.01, view.y(pose.points[4 * i + 3]));
        context.stroke();
      });
    }
  }
}

function drawGround(context, view, x, width) {
  context.strokeStyle = context.fillStyle = colour("--faint");
  context.lineWidth = 1;
  context.beginPath();
  context.moveTo(0, view.y(0));
  context.lineTo(width, view.y(0));
  const reach = width / view.scale;
  for (let metre = Math.ceil(x - reach); metre < x + reach; metre++) {
    context.moveTo(view.x(metre - x), view.y(0));
    context.lineTo(view.x(metre - x) - 6, view.y(0) + 10);
    if (metre % 2 === 0) context.fillText(`${metre} m`, view.x(metre - x) - 8, view.y(0) + 22);
  }
  context.stroke();
}

function fitted(element, width, height) {
  const ratio = window.devicePixelRatio || 1;
  if (element.width !== Math.round(width * ratio) || element.height !== Math.round(height * ratio)) {
    element.width = Math.round(width * ratio);
    element.height = Math.round(height * ratio);
  }
  const context = element.getContext("2d");
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, width, height);
  return context;
}

function tick(now) {
  if (!playing) return;
  advance(before === null ? 0 : (Number(byId("speed").value) * (now - before)) / 1000);
  before = now;
  requestAnimationFrame(tick);
}

function play(on) {
  playing = on;
  before = null;
  byId("play").textContent = on ? "Pause" : "Play";
  if (on) requestAnimationFrame(tick);
}

function changePace(by) {
  const index = PACES.indexOf(Number(byId("speed").value)) + by;
  byId("speed").value = PACES[Math.min(Math.max(index, 0), PACES.length - 1)];
}

// The controls that every player has, and its keys, except those that the focused control needs for itself.
function startPlayer(keys, show) {
  const shared = { " ": () => play(!playing), ArrowUp: () => changePace(1), ArrowDown: () => changePace(-1) };
  document.addEventListener("keydown", (event) => {
    const { tagName, type } = event.target;
    const own = tagName === "SELECT" || ((["BUTTON", "SUMMARY"].includes(tagName) || type === "checkbox") && event.key === " ");
    const action = { ...shared, ...keys }[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action || own || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault();
    action(event);
  });
  for (const pace of PACES) byId("speed").add(new Option(`${pace} ×`, pace, pace === 1, pace === 1));
  byId("play").addEventListener("click", () => play(!playing));
  new ResizeObserver(show).observe(canvas);
  window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
  show();
}
