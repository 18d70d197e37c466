// The cross-section as measured, seen along the inspection direction: 12 at the crown, 3 to the right.
// Input is a RESULT of the box; angles are image angles (0 at 3 o'clock, growing clockwise), lengths millimetres.

import { svg } from "./dom.js";

const HALF = 190; // half the width of the drawing
const WALL = 136; // where the larger of profile, fit and DN ring comes to lie

const radians = (degrees) => (degrees * Math.PI) / 180;
const number = (value) => value.toFixed(1);

// Runs of neighbouring angles that were seen, each a list of [angle, radius]; a run across 0 degrees is kept whole.
export function seenRuns(angles, radii) {
  const runs = [];
  let run = [];
  angles.forEach((angle, index) => {
    if (radii[index] === null) {
      if (run.length) runs.push(run);
      run = [];
    } else run.push([angle, radii[index]]);
  });
  if (run.length) runs.push(run);
  const seenAcross = runs.length && radii[0] !== null && radii[radii.length - 1] !== null;
  if (seenAcross && runs.length > 1) runs[0] = [...runs.pop(), ...runs[0]];
  return { runs, closed: Boolean(seenAcross) && runs.length === 1 && runs[0].length === angles.length };
}

export const clockAngle = (hour) => (hour - 3) * 30;

// A round length for the scale bar, some third of the diameter.
export function scaleLength(radius) {
  const aim = radius * 0.7;
  return [10, 20, 50, 100, 200, 500, 1000].reduce((best, step) => (Math.abs(step - aim) < Math.abs(best - aim) ? step : best));
}

export function crossSection(result) {
  const profile = result.profile;
  if (!profile || result.diameter_mm === null) return null;
  const fit = result.diameter_mm / 2;
  const nominal = Number(/\d+/.exec(result.dn?.name ?? "")?.[0] ?? 0) / 2;
  const seen = profile.radii_mm.filter((radius) => radius !== null);
  const scale = WALL / Math.max(fit, nominal, ...seen);
  const at = (angle, radius) => [radius * scale * Math.cos(radians(angle)), radius * scale * Math.sin(radians(angle))].map(number).join(" ");

  const parts = [svg("path", { class: "grid", d: `M ${-WALL} 0 H ${WALL} M 0 ${-WALL} V ${WALL}` })];
  if (profile.water) parts.push(water(profile.water, fit, at, scale));
  if (nominal) parts.push(svg("circle", { class: "ring", r: number(nominal * scale) }));
  parts.push(svg("circle", { class: "fit", r: number(fit * scale) }));
  const { runs, closed } = seenRuns(profile.angles_deg, profile.radii_mm);
  for (const run of runs) {
    const d = run.map(([angle, radius], index) => `${index ? "L" : "M"} ${at(angle, radius)}`).join(" ");
    parts.push(svg("path", { class: "measured", d: closed ? `${d} Z` : d }));
  }
  for (let hour = 1; hour <= 12; hour += 1) {
    const angle = radians(clockAngle(hour));
    const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
    const quarter = hour % 3 === 0;
    parts.push(svg("path", { class: "axis", d: `M ${number(146 * cos)} ${number(146 * sin)} L ${number(153 * cos)} ${number(153 * sin)}` }));
    parts.push(
      svg(
        "text",
        { x: number(168 * cos), y: number(168 * sin + 6), "text-anchor": "middle", "font-size": quarter ? 18 : 14, class: quarter ? "" : "quiet", "font-weight": quarter ? 700 : 400 },
        String(hour),
      ),
    );
  }
  parts.push(...scaleBar(scaleLength(fit), scale), ...legend(result, nominal, profile.water));
  return svg("svg", { viewBox: `${-HALF} ${-HALF + 4} ${2 * HALF} ${2 * HALF + 76}`, role: "img", "aria-label": inWords(result) }, parts);
}

function water({ from_clock: from, to_clock: to }, fit, at, scale) {
  // Whichever way round the ends are given, the water lies at 6 o'clock.
  const ends = [from, to].map((hour) => ((clockAngle(hour) % 360) + 360) % 360).sort((a, b) => a - b);
  const large = ends[1] - ends[0] > 180 ? 1 : 0;
  const r = number(fit * scale);
  return svg("path", { class: "water", d: `M ${at(ends[0], fit)} A ${r} ${r} 0 ${large} 1 ${at(ends[1], fit)} Z` });
}

function scaleBar(length, scale) {
  const width = length * scale;
  const y = 198;
  return [
    svg("path", { class: "axis", "stroke-width": 2, d: `M ${number(-width / 2)} ${y - 5} v 10 m 0 -5 h ${number(width)} m 0 -5 v 10` }),
    svg("text", { x: number(width / 2 + 8), y: y + 5, "font-size": 15 }, `${length} mm`),
  ];
}

function legend(result, nominal, hasWater) {
  const entries = [["measured", "measured wall"], ["fit", `circle ${result.diameter_mm.toFixed(0)} mm`]];
  if (nominal) entries.push(["ring", result.dn.name]);
  if (hasWater) entries.push(["water", "water"]);
  const places = [[-180, 228], [-20, 228], [-180, 254], [-20, 254]];
  return entries.flatMap(([kind, text], index) => [
    svg("path", { class: kind, d: `M ${places[index][0]} ${places[index][1]} h 24` }),
    svg("text", { x: places[index][0] + 32, y: places[index][1] + 5, "font-size": 15 }, text),
  ]);
}

export function inWords(result) {
  const { profile } = result;
  const parts = [
    `Cross-section: fitted circle of ${result.diameter_mm.toFixed(0)} millimetres`,
    `${profile.coverage_deg.toFixed(0)} of 360 degrees of the wall seen`,
  ];
  if (profile.minimum_mm !== null && profile.maximum_mm !== null) {
    parts.push(`measured diameters from ${profile.minimum_mm.toFixed(0)} to ${profile.maximum_mm.toFixed(0)} millimetres`);
  }
  if (profile.water) parts.push(`water ${profile.water.depth_mm.toFixed(0)} millimetres deep from ${profile.water.from_clock} to ${profile.water.to_clock} o'clock`);
  return `${parts.join(", ")}.`;
}
