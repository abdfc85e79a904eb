"use strict";
// The page of a student that follows commands: the student of the cell that is chosen and its reference, or the ramp.
const teacher = new Walk("teacher ");
walks = [new Walk(), teacher];
const [student] = walks;
const fields = [...document.querySelectorAll("[data-measure]")];
const { ramp } = walkers;
const rampEnd = ramp ? scene.dt * (ramp.steps - 1) : 0; // s
let onRamp = false;
let rampTime = 0; // s
let apart = true;

drawWalks = (context, width, height) => {
  const pair = apart && !onRamp;
  const scale = Math.min((height - 46) / scene.top, width / (pair ? 2.9 : 1.8));
  const view = (middle) => ({ scale, x: (x) => middle + scale * x, y: (y) => height - 30 - scale * y });
  const off = pair ? Math.min(width / 4, 0.8 * scale) : 0;
  const running = onRamp ? poseAt(ramp, rampTime) : null;
  drawGround(context, view(width / 2), running ? running.x : student.gone, width);
  if (running) return drawBody(context, running, view(width / 2), page.colors.student);
  if (student.walker) drawBody(context, student.pose, view(width / 2 - off), page.colors.student);
  if (teacher.walker) drawModel(context, teacher.pose, view(width / 2 + off), page.colors.teacher);
};

tellCell = ({ good, said, numbers, foot_radius, roll_over_radius }) => {
  Object.assign(scene, { foot_radius, roll_over_radius });
  if (onRamp) setRamp(false);
  byId("verdict").textContent = said;
  byId("verdict").className = good ? "" : "refused";
  for (const field of fields) field.textContent = numbers[field.dataset.measure][field.dataset.walker];
};

advance = (seconds) => {
  if (!onRamp) for (const walk of walks) walk.advance(seconds);
  else rampTime = (rampTime + seconds) % rampEnd;
  show();
};

clock = () => {
  if (!onRamp) return -1;
  byId("scrub").value = rampTime;
  byId("asked").textContent = `${rampTime.toFixed(1)} s`;
  byId("verdict").textContent = scene.ramp_now[Math.min(Math.round(rampTime / scene.dt), ramp.steps - 1)];
  return rampTime;
};

function setRamp(on) {
  onRamp = on && Boolean(ramp);
  byId("ramp")?.setAttribute("aria-pressed", String(onRamp));
  byId("cells").hidden = byId("numbers").hidden = onRamp;
  if (byId("scrub")) byId("scrub").hidden = !onRamp;
  for (const name of ["slower", "faster", "apart", "step"]) byId(name).disabled = onRamp;
}

function playRamp(on) {
  setRamp(on);
  if (onRamp) { byId("verdict").className = ""; show(); } else choose(cell);
}

function seek(to) {
  if (!ramp) return;
  rampTime = Math.min(Math.max(to, 0), rampEnd);
  playRamp(true);
}

function setApart(on) {
  apart = on;
  byId("apart").setAttribute("aria-pressed", String(on));
  show();
}

function bringInStep() {
  teacher.phase = student.phase;
  show();
}

const faster = (by) => () => (onRamp ? seek(rampTime + by) : changeSpeed(Math.sign(by)));
byId("apart").addEventListener("click", () => setApart(!apart));
byId("step").addEventListener("click", bringInStep);
byId("ramp")?.addEventListener("click", () => playRamp(!onRamp));
if (ramp) byId("scrub").max = rampEnd;
byId("scrub")?.addEventListener("input", (event) => seek(Number(event.target.value)));
goTo = seek;
startCells({
  ArrowLeft: faster(-0.5), ArrowRight: faster(0.5),
  a: () => setApart(!apart), s: bringInStep, r: () => playRamp(!onRamp),
});
