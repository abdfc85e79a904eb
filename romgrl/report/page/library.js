"use strict";
// The library's page: the reduced-order model walks as the cell that is chosen.
const [walk] = walks;
const fields = [...document.querySelectorAll("[data-measure]")];

drawWalks = (context, width, height) => {
  const scale = Math.min((height - 46) / scene.top, width / 1.8);
  const view = { scale, x: (x) => width / 2 + scale * x, y: (y) => height - 30 - scale * y };
  drawGround(context, view, walk.gone, width);
  if (walk.walker) drawModel(context, walk.pose, view, line.color);
};

tellCell = ({ fit, said, numbers, foot_radius, roll_over_radius }) => {
  Object.assign(scene, { foot_radius, roll_over_radius });
  byId("verdict").textContent = fit ? `Fit to be imitated: ${said}.` : `Refused: ${said}.`;
  byId("verdict").className = fit ? "" : "refused";
  fields.forEach((field, i) => { field.textContent = numbers[i]; });
  const shares = lines.filter((each) => each.gait === line.gait).map((each) => each.share);
  byId("share").replaceChildren(...shares.map((share) => new Option(`× ${share}`, share, false, share === line.share)));
};

byId("share").addEventListener("change", (event) => changeLine(line.gait, Number(event.target.value)));
startCells();
