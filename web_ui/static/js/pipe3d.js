// The pipe in 3-D with its landmarks on the wall, loaded when asked for; drawn on a plain 2-D canvas like the point cloud.
// A stretch of the pipe is shown, drawn shorter than it is: a sewer in its true proportions is a thread.

import { html } from "./dom.js";
import { isExtent, metresText } from "./drive_words.js";
import { View3d, projector } from "./view3d.js";

const SIDES = 48;
const RADII_LONG = 7; // how long the stretch is drawn, in radii
const LENGTHS_M = [5, 10, 20];
const REACH_PX = 28;
const COLORS = { connection: "#6fb1ff", deposit: "#e0a458", "displaced joint": "#e58bea", fracture: "#ff8a80", roots: "#7ddc83" };
const OTHER = "#d5dbe1";

// Image angle of a clock hour: 0 at 3 o'clock, 90 degrees at the invert.
export const angleOf = (hour) => ((hour - 3) * Math.PI) / 6;

// The wall of the unit cylinder: x right, y down, z along the pipe.
export const onWall = (z, angle, radius = 1) => [radius * Math.cos(angle), radius * Math.sin(angle), z];

class Pipe extends View3d {
  constructor(canvas, content, onPick) {
    super(canvas, { yaw: -0.95, pitch: -0.35, zoom: 1.12, ratio: 0.72 });
    this.onPick = onPick;
    this.span = Math.min(10, content.range.high - content.range.low);
    this.start = content.range.low;
    this.content = content;
    this.draw();
  }

  set(content) {
    this.content = content;
    this.place(this.start);
  }

  length(metres) {
    const { low, high } = this.content.range;
    const middle = this.start + this.span / 2;
    this.span = Math.min(metres, high - low);
    this.place(middle - this.span / 2);
  }

  place(start) {
    const { low, high } = this.content.range;
    this.start = Math.min(Math.max(start, low), Math.max(high - this.span, low));
    this.draw();
    this.onPlace?.();
  }

  key(name) {
    const pages = { PageDown: 0.5, PageUp: -0.5 }[name];
    if (pages) this.place(this.start + pages * this.span);
    return Boolean(pages);
  }

  tap(x, y) {
    const near = this.spots.map(([id, sx, sy, depth]) => [id, Math.hypot(sx - x, sy - y) / this.unit + depth]).filter(([, far]) => far < REACH_PX);
    if (near.length) this.onPick(near.reduce((a, b) => (b[1] < a[1] ? b : a))[0]);
  }

  draw() {
    const context = this.canvas.getContext("2d");
    this.fit();
    const { width, height } = this.canvas;
    const { unit } = this; // canvas points of one point on the screen
    const { landmarks, rings, crawler } = this.content;
    const [from, to] = [this.start, this.start + this.span];
    const z = (metres) => ((metres - from) / this.span - 0.5) * RADII_LONG;
    const project = projector({ centre: [0, 0, 0], yaw: this.yaw, pitch: this.pitch, zoom: this.zoom, width, height, size: RADII_LONG });
    const near = (p) => Math.min(Math.max(1.25 - (project(p)[2] - 1.6) * 0.8, 0.25), 1); // the far side is fainter
    const stroke = (points, alpha = null) => {
      for (let k = 1; k < points.length; k += 1) {
        context.globalAlpha = alpha ?? near(points[k]);
        const [a, b] = [project(points[k - 1]), project(points[k])];
        context.beginPath();
        context.moveTo(a[0], a[1]);
        context.lineTo(b[0], b[1]);
        context.stroke();
      }
    };
    const circle = (metres, turn = 2 * Math.PI, begin = 0) => Array.from({ length: SIDES + 1 }, (_, side) => onWall(z(metres), begin + (turn * side) / SIDES));
    const write = (words, [x, y], color) => {
      const size = 15 * unit;
      context.globalAlpha = 1;
      context.font = `700 ${size}px sans-serif`;
      context.textAlign = "center";
      context.lineWidth = 4 * unit;
      context.strokeStyle = "#05080b";
      context.strokeText(words, x, y + size / 3);
      context.fillStyle = color;
      context.fillText(words, x, y + size / 3);
    };
    const text = (words, p, color) => write(words, project(p), color);
    context.globalAlpha = 1;
    context.fillStyle = "#05080b";
    context.fillRect(0, 0, width, height);
    context.lineCap = "round";

    context.strokeStyle = "#5d6b79";
    context.lineWidth = 1.5 * unit;
    for (let hour = 1; hour <= 12; hour += 1) {
      context.lineWidth = (hour % 3 ? 1 : 2) * unit;
      stroke(Array.from({ length: 9 }, (_, k) => onWall(z(from + (this.span * k) / 8), angleOf(hour))));
    }
    context.lineWidth = 3 * unit;
    context.strokeStyle = "#9aa8b5";
    for (const end of [from, to]) stroke(circle(end));
    context.lineWidth = 1.6 * unit;
    context.strokeStyle = "#c9b28a";
    for (const ring of rings) if (ring.chainage_m > from && ring.chainage_m < to) stroke(circle(ring.chainage_m));
    if (crawler !== null && crawler >= from && crawler <= to) {
      context.strokeStyle = "#ffc53d";
      context.lineWidth = 4 * unit;
      stroke(circle(crawler), 1);
    }

    this.spots = [];
    const drawn = landmarks.filter((view) => !view.rejected && view.chainage_to_m >= from && view.chainage_m <= to);
    const middle = (view) => [Math.min(Math.max((view.chainage_m + view.chainage_to_m) / 2, from), to), angleOf(view.clock + view.reach / 2)];
    const deep = (view) => (view.clock === null ? 0 : project(onWall(z(middle(view)[0]), middle(view)[1]))[2]);
    for (const view of drawn.sort((a, b) => deep(b) - deep(a))) {
      const color = COLORS[view.class] ?? OTHER;
      context.strokeStyle = color;
      context.fillStyle = color;
      if (view.clock === null) {
        context.lineWidth = 2 * unit;
        context.setLineDash([8 * unit, 8 * unit]);
        stroke(circle(view.chainage_m), 0.9);
        context.setLineDash([]);
        const [x, y, depth] = project(onWall(z(view.chainage_m), angleOf(12)));
        this.spots.push([view.id, x, y, depth]);
        write(String(view.id), [x, y - 16 * unit], color);
        continue;
      }
      if (isExtent(view)) this.patch(context, view, { from, to, z, project });
      const [at, angle] = middle(view);
      const [x, y, depth] = project(onWall(z(at), angle));
      this.spots.push([view.id, x, y, depth]);
      context.globalAlpha = near(onWall(z(at), angle));
      context.beginPath();
      context.arc(x, y, 7 * unit, 0, 2 * Math.PI);
      context.lineWidth = 3 * unit;
      if (view.status === "candidate") context.stroke();
      else context.fill();
      write(String(view.id), [x + 17 * unit, y], color);
    }
    for (const metres of [from, to]) text(`${metresText(metres, 1)} m`, onWall(z(metres), angleOf(6), 1.4), "#f4f7f9");
    text("12", onWall(z(from), angleOf(12), 1.25), "#f4f7f9");
    text("3", onWall(z(from), angleOf(3), 1.25), "#f4f7f9");
    text("9", onWall(z(from), angleOf(9), 1.25), "#f4f7f9");
  }

  patch(context, view, { from, to, z, project }) {
    const [a, b] = [Math.max(view.chainage_m, from), Math.min(view.chainage_to_m, to)].map(z);
    const [begin, turn] = [angleOf(view.clock), (view.reach * Math.PI) / 6];
    const steps = 12;
    const edge = [];
    for (let k = 0; k <= steps; k += 1) edge.push(onWall(a, begin + (turn * k) / steps));
    for (let k = steps; k >= 0; k -= 1) edge.push(onWall(b, begin + (turn * k) / steps));
    context.beginPath();
    edge.forEach((p, k) => {
      const [x, y] = project(p);
      if (k) context.lineTo(x, y);
      else context.moveTo(x, y);
    });
    context.closePath();
    context.globalAlpha = 0.4;
    context.fill();
    context.globalAlpha = 0.9;
    context.lineWidth = 2 * this.unit;
    context.stroke();
  }
}

// Put the pipe with its buttons into `place`; onPick(id) when a landmark is tapped.
export function showPipe(place, content, onPick) {
  const canvas = html("canvas", {
    tabindex: 0,
    role: "img",
    "aria-label": "The pipe in 3-D with its landmarks. Arrow keys turn it, plus and minus zoom, Page up and Page down move along the pipe, Home resets. The list names each landmark.",
  });
  const pipe = new Pipe(canvas, content, onPick);
  const slider = html("input", { type: "range", id: "pipe3d-place", min: 0, max: 1000, step: 1, value: 0 });
  const length = html("select", { id: "pipe3d-length" }, [
    ...LENGTHS_M.map((metres) => html("option", { value: metres, ...(metres === 10 ? { selected: "" } : {}) }, `${metres} m`)),
    html("option", { value: 1e6 }, "Whole"),
  ]);
  const room = () => pipe.content.range.high - pipe.content.range.low - pipe.span;
  slider.addEventListener("input", () => pipe.place(pipe.content.range.low + (room() * slider.value) / 1000));
  length.addEventListener("change", () => pipe.length(Number(length.value)));
  pipe.onPlace = () => {
    if (document.activeElement !== slider) slider.value = room() > 0 ? (1000 * (pipe.start - pipe.content.range.low)) / room() : 0;
    slider.disabled = room() <= 0;
  };
  const along = html("div", { class: "pipe3d-along" }, [
    html("div", { class: "field grow" }, [html("label", { for: "pipe3d-place" }, "Along the pipe"), slider]),
    html("div", { class: "field" }, [html("label", { for: "pipe3d-length" }, "Length shown"), length]),
  ]);
  place.replaceChildren(canvas, pipe.buttons("Turn the pipe"), along, html("p", { class: "small" }, "Looking in the direction of the drive. The length is drawn shorter than it is."));
  pipe.onPlace();
  new ResizeObserver(() => pipe.draw()).observe(place);
  return pipe;
}
