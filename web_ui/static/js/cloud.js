// The point cloud, turned by drag, keys or buttons, drawn on a plain 2-D canvas: 3000 points need no more.

import { ask } from "./api.js";
import { html } from "./dom.js";
import { View3d, boundsOf, projector, square, unit } from "./view3d.js";

const RINGS = 7;
const SIDES = 40;

// The cylinder's wireframe as polylines of 3-D points: rings along the axis and four lines between them.
export function wireframe({ axis, point, radius, from, to }) {
  const along = unit(axis);
  const [u, v] = square(along);
  const at = (t, angle) => point.map((p, i) => p + t * along[i] + radius * (Math.cos(angle) * u[i] + Math.sin(angle) * v[i]));
  const lines = [];
  for (let ring = 0; ring < RINGS; ring += 1) {
    const t = from + ((to - from) * ring) / (RINGS - 1);
    lines.push(Array.from({ length: SIDES + 1 }, (_, side) => at(t, (2 * Math.PI * side) / SIDES)));
  }
  for (let side = 0; side < 8; side += 1) lines.push([at(from, (Math.PI * side) / 4), at(to, (Math.PI * side) / 4)]);
  return lines;
}

// Where along the axis the points on the wall lie, all but the outermost of them; nothing where there are too few.
export function seenLength({ points, inlier, cylinder: { axis, point } }) {
  const along = unit(axis);
  const places = points
    .filter((_, index) => inlier[index])
    .map((p) => p.reduce((sum, part, i) => sum + (part - point[i]) * along[i], 0))
    .sort((a, b) => a - b);
  if (places.length < 20) return {};
  return { from: places[Math.floor(places.length * 0.02)], to: places[Math.floor(places.length * 0.98)] };
}

// Pale on the wall, red inwards, blue outwards, full at 10 mm.
function deviationColour(mm) {
  const strength = Math.min(Math.abs(mm) / 10, 1);
  const [r, g, b] = mm < 0 ? [255, 70, 60] : [70, 150, 255];
  const mix = (part) => Math.round(205 + (part - 205) * strength);
  return `rgb(${mix(r)} ${mix(g)} ${mix(b)})`;
}

class CloudView extends View3d {
  constructor(canvas, cloud) {
    super(canvas, { yaw: -0.75, pitch: -0.35 });
    this.cloud = cloud;
    this.lines = cloud.cylinder ? wireframe({ ...cloud.cylinder, ...seenLength(cloud) }) : [];
    // The cylinder fills the view where there is one: a few stray points far away must not shrink it to nothing.
    const { centre, size } = boundsOf(this.lines.length ? this.lines.flat() : cloud.points);
    Object.assign(this, { centre, size: Math.max(size, 0.1) * 1.1 });
    this.draw();
  }

  draw() {
    const { canvas, cloud } = this;
    const context = canvas.getContext("2d");
    const { width, height } = canvas;
    const project = projector({ ...this, width, height });
    context.fillStyle = "#05080b";
    context.fillRect(0, 0, width, height);
    context.lineWidth = 1.5;
    context.strokeStyle = "rgba(255,255,255,0.55)";
    for (const line of this.lines) {
      context.beginPath();
      line.forEach((p, index) => {
        const [x, y] = project(p);
        if (index) context.lineTo(x, y);
        else context.moveTo(x, y);
      });
      context.stroke();
    }
    // Points off the wall differ by shape as well as by colour.
    cloud.points.forEach((p, index) => {
      const [x, y, depth] = project(p);
      if (depth < 0.2) return; // behind the eye
      if (cloud.inlier[index]) {
        context.fillStyle = cloud.deviation_mm ? deviationColour(cloud.deviation_mm[index]) : "#59c2ff";
        const side = Math.max(2, 6 / depth);
        context.fillRect(x - side / 2, y - side / 2, side, side);
      } else {
        context.strokeStyle = "#ffab40";
        context.beginPath();
        context.moveTo(x - 4, y - 4);
        context.lineTo(x + 4, y + 4);
        context.moveTo(x - 4, y + 4);
        context.lineTo(x + 4, y - 4);
        context.stroke();
      }
    });
  }
}

// Fetch the cloud of a survey and put the view with its buttons into `place`.
export async function showCloud(place, surveyId) {
  const cloud = await ask(`/cloud?survey_id=${surveyId}`);
  if (!cloud?.points?.length) {
    place.replaceChildren(html("p", {}, "No point cloud was kept with this survey."));
    return null;
  }
  const inside = cloud.inlier.reduce((sum, value) => sum + value, 0);
  const canvas = html("canvas", {
    width: 720,
    height: 540,
    tabindex: 0,
    role: "img",
    "aria-label": `Point cloud of ${cloud.points.length} points${cloud.deviation_mm ? "" : `, ${inside} of them on the fitted cylinder`}. Arrow keys turn it, plus and minus zoom, Home resets.`,
  });
  const view = new CloudView(canvas, cloud);
  const told = cloud.deviation_mm ? "Red points come inwards, blue ones fall outwards; full colour at 10 mm." : `Blue squares lie on the cylinder (${inside} of ${cloud.points.length} points), orange crosses do not.`;
  const words = html("p", { class: "small" }, told);
  place.replaceChildren(canvas, view.buttons("Turn the cloud"), words);
  return view;
}
