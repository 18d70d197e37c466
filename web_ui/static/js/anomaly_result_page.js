// A scan of the anomaly survey: the unrolled wall with its regions, the score along the pipe, the points when asked for.

import { ticks } from "./box_plot.js";
import { byId, data, html, localTimes, svg, wake } from "./dom.js";
import { scoreChart } from "./score_chart.js";
import { startShell } from "./shell.js";
import { openCloud, startDeletion } from "./survey_page.js";

const WIDTH = 360;
const LEFT = 40;
const RIGHT = 352;
const TOP = 8;
const BOTTOM = 248;

const { id, result, along } = data("survey-data");
const start = result?.chainage_m ?? 0;

// Across the drawing 6, 9, 12, 3 and 6 o'clock, as on the map of a drive; the share of the way from the left.
const across = (clock) => LEFT + (((((clock - 6) % 12) + 12) % 12) / 12) * (RIGHT - LEFT);

function wall() {
  const { near_m: near, far_m: far } = result;
  const up = (metres) => BOTTOM - ((metres - near) / (far - near)) * (BOTTOM - TOP);
  const parts = [
    svg("image", { href: `/api/v1/surveys/${id}/anomaly/wall.png`, x: LEFT, y: TOP, width: RIGHT - LEFT, height: BOTTOM - TOP, preserveAspectRatio: "none" }),
    svg("rect", { x: LEFT, y: TOP, width: RIGHT - LEFT, height: BOTTOM - TOP, class: "frame-line" }),
  ];
  [6, 9, 12, 3, 6].forEach((clock, index) => {
    const x = LEFT + (index / 4) * (RIGHT - LEFT);
    parts.push(svg("text", { x, y: BOTTOM + 16, "text-anchor": index === 4 ? "end" : "middle" }, `${clock}`));
  });
  parts.push(svg("text", { x: (LEFT + RIGHT) / 2, y: BOTTOM + 32, "text-anchor": "middle" }, "o'clock"));
  const { values, digits } = ticks(start + near, start + far, 5);
  for (const value of values) parts.push(svg("text", { x: LEFT - 5, y: up(value - start) + 4, "text-anchor": "end" }, value.toFixed(digits)));
  parts.push(svg("text", { x: 2, y: BOTTOM + 32 }, "m"));
  result.regions.forEach((region, index) => parts.push(...box(region, index + 1, up)));
  return svg("svg", { viewBox: `0 0 ${WIDTH} ${BOTTOM + 38}`, role: "img", "aria-label": `Unrolled wall with ${result.regions.length} places marked; they are listed below` }, parts);
}

// A region that reaches over the edge of the drawing at 6 o'clock is drawn in two pieces.
function box(region, number, up) {
  const half = (region.width_hours / 24) * (RIGHT - LEFT) + 3;
  const x = across(region.clock);
  const [top, bottom] = [Math.max(up(region.to_m) - 3, TOP), Math.min(up(region.from_m) + 3, BOTTOM)];
  const pieces = [[x - half, x + half]];
  if (x - half < LEFT) pieces.push([x - half + RIGHT - LEFT, RIGHT]);
  if (x + half > RIGHT) pieces.push([LEFT, x + half - RIGHT + LEFT]);
  const parts = [];
  for (const [from, to] of pieces) {
    const at = { x: Math.max(from, LEFT), y: top, width: Math.max(Math.min(to, RIGHT) - Math.max(from, LEFT), 2), height: Math.max(bottom - top, 6), rx: 2 };
    parts.push(svg("rect", { ...at, class: "region-case" }), svg("rect", { ...at, class: region.expected ? "region expected" : "region" }));
  }
  const [tagX, tagY] = [Math.min(Math.max(x, LEFT + 9), RIGHT - 9), top - 11 < TOP ? bottom + 11 : top - 11];
  parts.push(svg("circle", { cx: tagX, cy: tagY, r: 9, class: "tag" }), svg("text", { x: tagX, y: tagY + 4, "text-anchor": "middle", class: "tag-text" }, `${number}`));
  return parts;
}

function showPicture(kind) {
  byId("picture").src = `/api/v1/surveys/${id}/anomaly/${kind}.jpg`;
  for (const name of ["overlay", "reference"]) byId(`show-${name}`).setAttribute("aria-pressed", String(name === kind));
}

startShell();
localTimes();
startDeletion(id);
if (along.surveys.length > 1) byId("along").replaceChildren(scoreChart(along.bands));
if (result?.fitted) {
  byId("wall").replaceChildren(wall());
  const bands = result.bands.map((band) => ({ ...band, from_m: start + band.first_m, to_m: start + band.last_m }));
  byId("bands").replaceChildren(bands.length ? scoreChart(bands) : html("p", {}, "No band was measured."));
  byId("show-overlay").addEventListener("click", () => showPicture("overlay"));
  byId("show-reference").addEventListener("click", () => showPicture("reference"));
  byId("cloud-show").addEventListener("click", () => openCloud(id));
}
wake();
