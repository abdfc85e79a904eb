"use strict";
// The report's player: student, baseline and teacher over one another, and every cursor at their time.
const duration = scene.dt * (scene.steps - 1);
const layer = document.createElement("canvas");
const shown = new Set(Object.keys(walkers));
let apart = false;
let time = scene.first * scene.dt; // where all walkers are there
const places = Object.fromEntries([...document.querySelectorAll("[data-distance]")].map((e) => [e.dataset.distance, e]));
let span = null; // [start, stop] in seconds of the stride that is looped

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

function show() {
  const distances = drawScene(time);
  byId("scrub").value = time;
  byId("clock").textContent = `${time.toFixed(2)} of ${duration.toFixed(2)} s`;
  for (const [name, x] of Object.entries(distances)) {
    const text = x === null ? "not recorded here" : `${x.toFixed(1)} m`;
    if (places[name].textContent !== text) places[name].textContent = text;
  }
  placeCursors(time);
}

advance = (seconds) => {
  const [start, stop] = span || [0, duration];
  time += seconds;
  if (time > stop || time < start) time = start + ((time - start) % (stop - start) + (stop - start)) % (stop - start);
  show();
};

// Where the dot of a walker is on a chart: at its own step, nowhere while it is hidden.
pointAt = (name, cursor, at) => {
  const step = Math.round(at / scene.dt) - cursor.offset;
  const [x, y] = [cursor.x[step], cursor.y[step]];
  return !shown.has(name) || x === undefined || x === null || y === null ? null : [x, y];
};

function seek(to) {
  time = Math.min(Math.max(to, 0), duration);
  if (span && (time < span[0] || time > span[1])) loop(false);
  show();
}

// The stride around the cursor, from touchdown to touchdown of the left foot, of the first walker that has one there.
function strideAround(at) {
  for (const name of ["student", "baseline", "teacher"]) {
    if (!walkers[name] || !shown.has(name) || walkers[name].strides.length < 2) continue;
    const starts = walkers[name].strides.map((step) => step * scene.dt);
    const index = Math.min(Math.max(starts.filter((start) => start <= at + 1e-6).length - 1, 0), starts.length - 2);
    return [starts[index], starts[index + 1]];
  }
  return null;
}

function loop(on) {
  span = on ? strideAround(time) : null;
  byId("loop").setAttribute("aria-pressed", String(span !== null));
  if (span && (time < span[0] || time > span[1])) time = span[0];
  show();
}

function setApart(on) {
  apart = on;
  byId("apart").setAttribute("aria-pressed", String(on));
  show();
}

const KEYS = {
  ArrowLeft: (event) => seek(time - scene.dt * (event.shiftKey ? 10 : 1)),
  ArrowRight: (event) => seek(time + scene.dt * (event.shiftKey ? 10 : 1)),
  Home: () => seek(0),
  End: () => seek(duration),
  l: () => loop(span === null),
  a: () => setApart(!apart),
  1: () => document.querySelectorAll("#walkers input")[0]?.click(),
  2: () => document.querySelectorAll("#walkers input")[1]?.click(),
  3: () => document.querySelectorAll("#walkers input")[2]?.click(),
};

byId("scrub").max = duration;
byId("scrub").addEventListener("input", (event) => seek(Number(event.target.value)));
byId("back").addEventListener("click", () => seek(time - scene.dt));
byId("forward").addEventListener("click", () => seek(time + scene.dt));
byId("loop").addEventListener("click", () => loop(span === null));
byId("apart").addEventListener("click", () => setApart(!apart));
byId("walkers").addEventListener("change", (event) => {
  event.target.checked ? shown.add(event.target.value) : shown.delete(event.target.value);
  show();
});
goTo = seek;
startPlayer(KEYS, show);
