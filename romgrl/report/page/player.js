"use strict";
// The recorded gaits: points in whole millimetres, forward of each walker's root, drawn on a canvas.
const page = JSON.parse(document.getElementById("data").textContent);
const scene = page.scene;
const walkers = scene.walkers;
const duration = scene.dt * (scene.steps - 1);
const canvas = document.getElementById("stage");
const layer = document.createElement("canvas");
const shown = new Set(Object.keys(walkers));
let apart = false;

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
    context.beginPath();
    context.arc(x, y, scene.foot_radius * view.scale, 0, 2 * Math.PI);
    if (pose.contact[foot]) context.fill();
    context.stroke();
  }
  context.fillStyle = tone;
  context.beginPath();
  context.arc(hipX, hipY, 0.06 * view.scale, 0, 2 * Math.PI);
  context.fill();
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

// All walkers at a time; returns how far each has gone, in metres.
function drawScene(time) {
  const [width, height] = [canvas.clientWidth, canvas.clientHeight];
  if (!width || !height) return {};
  const context = fitted(canvas, width, height);
  const names = ["baseline", "student", "teacher"].filter((name) => shown.has(name) && name in walkers);
  const scale = Math.min((height - 46) / 1.95, apart ? width / (1.5 * Math.max(1, names.length)) : width / 1.8);
  const ground = height - 30;
  const poses = Object.fromEntries(Object.keys(walkers).map((name) => [name, poseAt(walkers[name], time)]));
  const leader = ["student", "baseline", "teacher"].find((name) => shown.has(name) && poses[name]);
  context.font = "11px system-ui, sans-serif";
  const reach = Math.min(width, 2.6 * scale); // no limb leaves it
  const view = (middle) => ({ scale, x: (x) => middle + scale * x, y: (y) => ground - scale * y });
  drawGround(context, view(width / 2), leader ? poses[leader].x : 0, width);
  names.forEach((name, place) => {
    if (!poses[name]) return;
    const shift = apart ? ((place + 0.5) / names.length - 0.5) * Math.min(width, 1.6 * scale * names.length) : 0;
    const over = fitted(layer, reach, height);
    (name === "teacher" ? drawModel : drawBody)(over, poses[name], view(reach / 2), page.colors[name]);
    context.globalAlpha = name === "teacher" || apart ? 1 : name === "student" ? 0.85 : 0.6;
    context.drawImage(layer, width / 2 + shift - reach / 2, 0, reach, height);
    context.globalAlpha = 1;
  });
  return Object.fromEntries(Object.entries(poses).map(([name, pose]) => [name, pose && pose.x]));
}
