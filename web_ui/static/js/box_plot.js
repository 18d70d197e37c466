// The diameters of the frames of a recording as a box plot: quartiles, median, whiskers to the last value within 1.5 box lengths, every frame a point.

import { svg } from "./dom.js";

const WIDTH = 380;
const LEFT = 26;
const RIGHT = 354;

// The quantile by linear interpolation between the sorted values (the usual definition of numpy and R's type 7).
export function quantile(sorted, share) {
  const place = (sorted.length - 1) * share;
  const low = Math.floor(place);
  return sorted[low] + (place - low) * ((sorted[low + 1] ?? sorted[low]) - sorted[low]);
}

export function boxNumbers(values) {
  const sorted = [...values].sort((a, b) => a - b);
  const [lower, median, upper] = [0.25, 0.5, 0.75].map((share) => quantile(sorted, share));
  const reach = 1.5 * (upper - lower);
  const within = sorted.filter((value) => value >= lower - reach && value <= upper + reach);
  return { lower, median, upper, low: within[0], high: within[within.length - 1], outliers: sorted.filter((value) => value < within[0] || value > within[within.length - 1]) };
}

// Round tick values across [low, high], some `count` of them.
export function ticks(low, high, count = 4) {
  const raw = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(raw));
  const step = [1, 2, 5, 10].map((factor) => factor * power).find((candidate) => candidate >= raw * 0.999);
  const result = [];
  for (let value = Math.ceil(low / step) * step; value <= high + step * 1e-9; value += step) result.push(value);
  return { values: result, digits: step < 1 ? Math.ceil(-Math.log10(step)) : 0 };
}

// What the plot spans: the frames, and the interval too unless that would squeeze the frames into a line.
export function extent(values, interval) {
  const [least, most] = [Math.min(...values), Math.max(...values)];
  const spread = Math.max(most - least, 0.5);
  const [from, to] = interval ?? [least, most];
  if (values.length > 2 && Math.max(to, most) - Math.min(from, least) > 8 * spread) return [least - 0.6 * spread, most + 0.6 * spread];
  const margin = Math.max((Math.max(to, most) - Math.min(from, least)) * 0.06, 0.3);
  return [Math.min(from, least) - margin, Math.max(to, most) + margin];
}

export function boxPlot(frames, interval) {
  const values = frames.map((frame) => frame.diameter_mm).filter((value) => value !== null && value !== undefined);
  if (!values.length) return null;
  const box = boxNumbers(values);
  const [low, high] = extent(values, interval);
  const x = (value) => (LEFT + ((value - low) / (high - low)) * (RIGHT - LEFT)).toFixed(1);
  const scale = ticks(low, high);

  const parts = [];
  if (interval) {
    const [from, to] = [x(Math.max(interval[0], low)), x(Math.min(interval[1], high))];
    const beyond = interval[0] < low && interval[1] > high;
    const words = beyond ? `all within the 95 % interval, ${interval[0].toFixed(0)} to ${interval[1].toFixed(0)} mm` : "95 % interval";
    if (to - from > 0) parts.push(svg("rect", { class: "band", x: from, y: 14, width: (to - from).toFixed(1), height: 134 }));
    parts.push(svg("text", { class: "quiet", x: ((+from + +to) / 2).toFixed(1), y: 11, "font-size": 13, "text-anchor": "middle" }, words));
  }
  for (const tick of scale.values) {
    parts.push(svg("path", { class: "grid", d: `M ${x(tick)} 18 V 152` }));
    parts.push(svg("text", { x: x(tick), y: 171, "font-size": 15, "text-anchor": "middle" }, tick.toFixed(scale.digits)));
  }
  parts.push(
    svg("path", { class: "whisker", d: `M ${x(box.low)} 54 H ${x(box.lower)} M ${x(box.upper)} 54 H ${x(box.high)} M ${x(box.low)} 42 V 66 M ${x(box.high)} 42 V 66` }),
    svg("rect", { class: "box", x: x(box.lower), y: 30, width: Math.max(x(box.upper) - x(box.lower), 1).toFixed(1), height: 48, rx: 3 }),
    svg("path", { class: "median", d: `M ${x(box.median)} 28 V 80` }),
  );
  values.forEach((value, index) => {
    const outside = box.outliers.includes(value);
    // Spread over the height by the golden ratio: even, and the same at every drawing.
    const y = 96 + ((index * 0.618034) % 1) * 46;
    parts.push(svg("circle", { class: outside ? "outlier" : "dot", cx: x(value), cy: y.toFixed(1), r: outside ? 4.5 : 4 }));
  });
  parts.push(svg("text", { class: "quiet", x: RIGHT, y: 192, "font-size": 14, "text-anchor": "end" }, "diameter, mm"));
  parts.push(svg("text", { class: "quiet", x: LEFT, y: 192, "font-size": 14 }, framesInWords(frames.length, values.length)));
  const label = `Box plot of ${values.length} diameters: median ${box.median.toFixed(1)}, half of them between ${box.lower.toFixed(1)} and ${box.upper.toFixed(1)} millimetres.`;
  return svg("svg", { viewBox: `0 0 ${WIDTH} 200`, role: "img", "aria-label": label }, parts);
}

function framesInWords(all, fitted) {
  const frames = all === 1 ? "1 frame" : `${all} frames`;
  return all === fitted ? frames : `${frames}, ${all - fitted} without a pipe`;
}
