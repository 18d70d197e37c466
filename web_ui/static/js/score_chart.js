// The score along a pipe: bars for each band, inwards upwards, outwards downwards; where less than half was measured the ground is
// grey.

import { ticks } from "./box_plot.js";
import { svg } from "./dom.js";

const [WIDTH, LEFT, RIGHT] = [360, 40, 352];
const [MIDDLE, REACH] = [90, 74];

// `bands` have from_m, to_m, score_mm, outward_mm and measured, in their order along the pipe.
export function scoreChart(bands) {
  const most = Math.max(1, ...bands.flatMap((band) => [band.score_mm ?? 0, band.outward_mm ?? 0]));
  const [first, last] = [bands[0].from_m, bands[bands.length - 1].to_m];
  const right = (metres) => LEFT + ((metres - first) / (last - first)) * (RIGHT - LEFT);
  const parts = [];
  for (const band of bands) {
    const [x, width] = [right(band.from_m), right(band.to_m) - right(band.from_m)];
    const [inward, outward] = [band.score_mm ?? 0, band.outward_mm ?? 0].map((value) => (value / most) * REACH);
    const gap = Math.min(1, width / 5);
    if (band.measured < 0.5) parts.push(svg("rect", { x, y: MIDDLE - REACH, width, height: 2 * REACH, class: "unmeasured" }));
    parts.push(svg("rect", { x: x + gap, y: MIDDLE - inward, width: width - 2 * gap, height: inward, class: "inward" }));
    parts.push(svg("rect", { x: x + gap, y: MIDDLE, width: width - 2 * gap, height: outward, class: "outward" }));
  }
  parts.push(svg("path", { d: `M${LEFT} ${MIDDLE}H${RIGHT}`, class: "axis" }));
  for (const [y, text] of [[MIDDLE - REACH + 4, most.toFixed(1)], [MIDDLE + 4, "0"], [MIDDLE + REACH + 4, most.toFixed(1)]]) parts.push(svg("text", { x: LEFT - 5, y, "text-anchor": "end" }, text));
  parts.push(svg("text", { x: RIGHT, y: MIDDLE - REACH + 4, "text-anchor": "end" }, "inwards, mm"), svg("text", { x: RIGHT, y: MIDDLE + REACH + 4, "text-anchor": "end" }, "outwards, mm"));
  const { values, digits } = ticks(first, last, 4);
  for (const value of values) parts.push(svg("text", { x: right(value), y: MIDDLE + REACH + 22, "text-anchor": right(value) > RIGHT - 12 ? "end" : "middle" }, value.toFixed(digits)));
  parts.push(svg("text", { x: 2, y: MIDDLE + REACH + 22 }, "m"));
  return svg("svg", { viewBox: `0 0 ${WIDTH} ${MIDDLE + REACH + 28}`, role: "img", "aria-label": "Mean deviation inwards and outwards in each band along the pipe; the table below has the numbers" }, parts);
}
