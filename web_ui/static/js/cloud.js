// The point cloud, turned by drag, keys or buttons, drawn on a plain 2-D canvas: 3000 points need no more.

import { ask } from "./api.js";
import { html } from "./dom.js";

const RINGS = 7;
const SIDES = 40;
const STEP = 0.16;

const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const unit = (a) => a.map((part) => part / Math.hypot(...a));

// The cylinder's wireframe as polylines of 3-D points: rings along the axis and four lines between them.
export function wireframe({ axis, point, radius, from, to }) {
  const along = unit(axis);
  const u = unit(cross(along, Math.abs(along[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0]));
  const v = cross(along, u);
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

export function projector({ centre, yaw, pitch, zoom, width, height, size }) {
  const [cy, sy, cp, sp] = [Math.cos(yaw), Math.sin(yaw), Math.cos(pitch), Math.sin(pitch)];
  const focal = (Math.min(width, height) / size) * zoom * 2.2;
  return (p) => {
    const [x, y, z] = p.map((part, i) => part - centre[i]);
    const x1 = cy * x + sy * z;
    const z1 = -sy * x + cy * z;
    const y2 = cp * y - sp * z1;
    const z2 = sp * y + cp * z1;
    const depth = z2 / size + 2.2;
    return [width / 2 + (focal * x1) / depth, height / 2 + (focal * y2) / depth, depth];
  };
}

// Pale on the wall, red inwards, blue outwards, full at 10 mm.
function deviationColour(mm) {
  const strength = Math.min(Math.abs(mm) / 10, 1);
  const [r, g, b] = mm < 0 ? [255, 70, 60] : [70, 150, 255];
  const mix = (part) => Math.round(205 + (part - 205) * strength);
  return `rgb(${mix(r)} ${mix(g)} ${mix(b)})`;
}

export class CloudView {
  constructor(canvas, cloud) {
    this.canvas = canvas;
    this.cloud = cloud;
    this.lines = cloud.cylinder ? wireframe({ ...cloud.cylinder, ...seenLength(cloud) }) : [];
    // The cylinder fills the view where there is one: a few stray points far away must not shrink it to nothing.
    const shown = this.lines.length ? this.lines.flat() : cloud.points;
    const range = [0, 1, 2].map((i) => shown.reduce(([a, b], p) => [Math.min(a, p[i]), Math.max(b, p[i])], [Infinity, -Infinity]));
    this.centre = range.map(([a, b]) => (a + b) / 2);
    this.size = Math.max(...range.map(([a, b]) => b - a), 0.1) * 1.1;
    this.home();
    canvas.addEventListener("pointerdown", (event) => {
      this.last = [event.clientX, event.clientY];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!this.last) return;
      this.turn((event.clientX - this.last[0]) / 140, (event.clientY - this.last[1]) / 140);
      this.last = [event.clientX, event.clientY];
    });
    for (const name of ["pointerup", "pointercancel"]) canvas.addEventListener(name, () => (this.last = null));
    canvas.addEventListener("keydown", (event) => {
      const action = { ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, -STEP], ArrowDown: [0, STEP] }[event.key];
      if (action) this.turn(...action);
      else if (event.key === "+" || event.key === "=") this.magnify(1.2);
      else if (event.key === "-") this.magnify(1 / 1.2);
      else if (event.key === "Home") this.home();
      else return;
      event.preventDefault();
    });
  }

  home() {
    Object.assign(this, { yaw: -0.75, pitch: -0.35, zoom: 1 });
    this.draw();
  }

  turn(yaw, pitch) {
    this.yaw += yaw;
    this.pitch = Math.min(Math.max(this.pitch + pitch, -1.5), 1.5);
    this.draw();
  }

  magnify(factor) {
    this.zoom = Math.min(Math.max(this.zoom * factor, 0.4), 6);
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
  const button = (text, label, action) => {
    const element = html("button", { type: "button", class: "button quiet", "aria-label": label }, text);
    element.addEventListener("click", action);
    return element;
  };
  const buttons = html("div", { class: "cloud-buttons", role: "group", "aria-label": "Turn the cloud" }, [
    button("◀", "Turn left", () => view.turn(-STEP * 2, 0)),
    button("▶", "Turn right", () => view.turn(STEP * 2, 0)),
    button("▲", "Turn up", () => view.turn(0, -STEP * 2)),
    button("▼", "Turn down", () => view.turn(0, STEP * 2)),
    button("+", "Closer", () => view.magnify(1.3)),
    button("−", "Farther", () => view.magnify(1 / 1.3)),
  ]);
  const told = cloud.deviation_mm ? "Red points come inwards, blue ones fall outwards; full colour at 10 mm." : `Blue squares lie on the cylinder (${inside} of ${cloud.points.length} points), orange crosses do not.`;
  const words = html("p", { class: "small" }, told);
  place.replaceChildren(canvas, buttons, words);
  return view;
}
