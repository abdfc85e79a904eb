"use strict";
// The clock that moves the player and every cursor, its controls and keys.
const SPEEDS = [0.1, 0.25, 0.5, 1, 2];
const byId = (id) => document.getElementById(id);
let time = scene.first * scene.dt; // where all walkers are there
const places = Object.fromEntries([...document.querySelectorAll("[data-distance]")].map((e) => [e.dataset.distance, e]));
let playing = false;
let span = null; // [start, stop] in seconds of the stride that is looped
let before = null;

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

function tick(now) {
  if (!playing) return;
  const [start, stop] = span || [0, duration];
  time += before === null ? 0 : (Number(byId("speed").value) * (now - before)) / 1000;
  if (time > stop || time < start) time = start + ((time - start) % (stop - start) + (stop - start)) % (stop - start);
  before = now;
  show();
  requestAnimationFrame(tick);
}

function play(on) {
  playing = on;
  before = null;
  byId("play").textContent = on ? "Pause" : "Play";
  if (on) requestAnimationFrame(tick);
}

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

function changeSpeed(by) {
  const index = SPEEDS.indexOf(Number(byId("speed").value)) + by;
  byId("speed").value = SPEEDS[Math.min(Math.max(index, 0), SPEEDS.length - 1)];
}

const KEYS = {
  " ": () => play(!playing),
  ArrowLeft: (event) => seek(time - scene.dt * (event.shiftKey ? 10 : 1)),
  ArrowRight: (event) => seek(time + scene.dt * (event.shiftKey ? 10 : 1)),
  ArrowUp: () => changeSpeed(1),
  ArrowDown: () => changeSpeed(-1),
  Home: () => seek(0),
  End: () => seek(duration),
  l: () => loop(span === null),
  a: () => setApart(!apart),
  1: () => document.querySelectorAll("#walkers input")[0]?.click(),
  2: () => document.querySelectorAll("#walkers input")[1]?.click(),
  3: () => document.querySelectorAll("#walkers input")[2]?.click(),
};

// Keys are the player's, except those that the focused control needs for itself.
document.addEventListener("keydown", (event) => {
  const { tagName, type } = event.target;
  const own = tagName === "SELECT" || ((tagName === "BUTTON" || tagName === "SUMMARY" || type === "checkbox") && event.key === " ");
  const action = KEYS[event.key.length === 1 ? event.key.toLowerCase() : event.key];
  if (!action || own || event.ctrlKey || event.metaKey || event.altKey) return;
  event.preventDefault();
  action(event);
});

for (const speed of SPEEDS) byId("speed").add(new Option(`${speed} ×`, speed, speed === 1, speed === 1));
byId("scrub").max = duration;
byId("scrub").addEventListener("input", (event) => seek(Number(event.target.value)));
byId("play").addEventListener("click", () => play(!playing));
byId("back").addEventListener("click", () => seek(time - scene.dt));
byId("forward").addEventListener("click", () => seek(time + scene.dt));
byId("loop").addEventListener("click", () => loop(span === null));
byId("apart").addEventListener("click", () => setApart(!apart));
byId("walkers").addEventListener("change", (event) => {
  event.target.checked ? shown.add(event.target.value) : shown.delete(event.target.value);
  show();
});
new ResizeObserver(show).observe(canvas);
window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", show);
goTo = seek;
show();
