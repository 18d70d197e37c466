// A chamber in 3-D on a plain 2-D canvas: pipes as shaded cylinders, objects as discs with their number and belief, the track.
// The box's axes are north, east and down; drawn are east to the right, down downwards, north away from the eye.

import { html } from "./dom.js";
import { View3d, boundsOf, projector, square, unit } from "./view3d.js";

export const CLASSES = {
  "ball valve": { color: "#ff7b72", letter: "B" },
  elbow: { color: "#6fb1ff", letter: "E" },
  tee: { color: "#7ddc83", letter: "T" },
  socket: { color: "#c9a6ff", letter: "S" },
  "butterfly valve": { color: "#ffb057", letter: "F" },
  "3-way valve": { color: "#f49ad2", letter: "W" },
};
export const SURE = 0.97;
const SIDES = 14;
const PIECE_M = 0.2;

const seen = ([north, east, down]) => [east, down, north];
const minus = (a, b) => a.map((part, i) => part - b[i]);

// The wall of a pipe as quads with their normals: short pieces, so that sorting by depth puts each in its place.
export function cylinder(from, to, radius) {
  const along = minus(to, from);
  const length = Math.hypot(...along);
  const [u, v] = square(unit(along));
  const normal = (k) => u.map((part, i) => part * Math.cos((2 * Math.PI * k) / SIDES) + v[i] * Math.sin((2 * Math.PI * k) / SIDES));
  const pieces = Math.max(1, Math.round(length / PIECE_M));
  const faces = [];
  for (let piece = 0; piece < pieces; piece += 1) {
    const [a, b] = [piece / pieces, (piece + 1) / pieces];
    for (let k = 0; k < SIDES; k += 1) {
      const [m, n] = [normal(k), normal(k + 1)];
      const at = (share, out) => from.map((part, i) => part + share * along[i] + radius * out[i]);
      faces.push({ corners: [at(a, m), at(b, m), at(b, n), at(a, n)], normal: unit(m.map((part, i) => part + n[i])) });
    }
  }
  return faces;
}

export class Chamber3d extends View3d {
  constructor(canvas) {
    super(canvas, { yaw: -0.6, pitch: -0.45 });
    this.map = { pipes: [], objects: [], track: [], next_view: null };
    this.faces = [];
    Object.assign(this, { centre: [0, 0, 0], size: 2 });
    this.draw();
  }

  set(map) {
    this.map = map;
    this.faces = map.pipes.flatMap((pipe) => cylinder(seen(pipe.from), seen(pipe.to), pipe.radius_m));
    const ends = [...map.pipes.flatMap((pipe) => [pipe.from, pipe.to]), ...map.objects.map((thing) => thing.position)].map(seen);
    const points = ends.length ? ends : map.track.map((one) => seen(one.position));
    if (points.length) {
      const { centre, size } = boundsOf(points);
      Object.assign(this, { centre, size: Math.max(size, 0.5) * 1.75 });
    }
    this.draw();
  }

  draw() {
    const context = this.canvas.getContext("2d");
    this.fit();
    const { width, height } = this.canvas;
    const project = projector({ ...this, width, height });
    context.fillStyle = "#05080b";
    context.fillRect(0, 0, width, height);
    this.drawTrack(context, project);
    const items = this.faces.map((face) => this.shaded(face, project)).filter(Boolean);
    items.push(...this.map.objects.map((thing) => this.disc(thing, project)).filter(Boolean));
    items.sort((a, b) => b.depth - a.depth);
    for (const item of items) item.draw(context);
    this.drawNext(context, project);
  }

  shaded(face, project) {
    const corners = face.corners.map(project);
    const depth = corners.reduce((sum, corner) => sum + corner[2], 0) / corners.length;
    if (depth < 0.2) return null;
    // Faces that look away are behind their own pipe: the turn of the corners on the screen tells.
    let area = 0;
    corners.forEach(([x, y], k) => {
      const [nx, ny] = corners[(k + 1) % corners.length];
      area += x * ny - nx * y;
    });
    if (area >= 0) return null;
    const light = Math.max(0, -(0.35 * face.normal[0] + 0.75 * face.normal[1] + 0.55 * face.normal[2]));
    const grey = Math.round(92 + 128 * light);
    const color = `rgb(${grey} ${grey + 8} ${grey + 14})`;
    const draw = (context) => {
      context.fillStyle = color;
      context.strokeStyle = color;
      context.lineWidth = 0.7;
      context.beginPath();
      corners.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
      context.closePath();
      context.fill();
      context.stroke();
    };
    return { depth, draw };
  }

  disc(thing, project) {
    const [x, y, depth] = project(seen(thing.position));
    if (depth < 0.2) return null;
    const { color, letter } = CLASSES[thing.class] ?? { color: "#d5dbe1", letter: "?" };
    const radius = (11 * this.unit * 2.2) / depth / 1.15;
    const draw = (context) => {
      context.beginPath();
      context.arc(x, y, radius, 0, 2 * Math.PI);
      context.fillStyle = color;
      context.fill();
      // The share of the ring that is white is the belief.
      context.lineWidth = 2.5 * this.unit;
      context.strokeStyle = "#33404c";
      context.stroke();
      context.beginPath();
      context.arc(x, y, radius, -Math.PI / 2, -Math.PI / 2 + 2 * Math.PI * thing.belief);
      context.strokeStyle = "#fff";
      context.stroke();
      context.fillStyle = "#05080b";
      context.font = `700 ${Math.max(9 * this.unit, radius * 1.05)}px system-ui, sans-serif`;
      context.textAlign = "center";
      context.textBaseline = "middle";
      context.fillText(thing.belief < SURE ? `${letter}?` : letter, x, y);
      context.font = `600 ${11 * this.unit}px system-ui, sans-serif`;
      context.lineWidth = 3 * this.unit;
      context.strokeStyle = "#05080b";
      context.strokeText(String(thing.number), x + radius + 9 * this.unit, y - radius * 0.6);
      context.fillStyle = color;
      context.fillText(String(thing.number), x + radius + 9 * this.unit, y - radius * 0.6);
    };
    return { depth: depth - 0.08, draw }; // in front of the pipes that meet there
  }

  drawTrack(context, project) {
    const points = this.map.track.map((one) => project(seen(one.position)));
    context.strokeStyle = "#ffc53d";
    context.lineWidth = 1.5 * this.unit;
    context.beginPath();
    points.forEach(([x, y, depth], k) => (k && depth > 0.2 && points[k - 1][2] > 0.2 ? context.lineTo(x, y) : context.moveTo(x, y)));
    context.stroke();
    const last = points.at(-1);
    if (last && last[2] > 0.2) {
      context.fillStyle = "#ffc53d";
      context.beginPath();
      context.arc(last[0], last[1], 6 * this.unit, 0, 2 * Math.PI);
      context.fill();
    }
  }

  drawNext(context, project) {
    const next = this.map.next_view;
    if (!next) return;
    const [from, to] = [project(seen(next.position)), project(seen(next.target))];
    if (from[2] < 0.2 || to[2] < 0.2) return;
    context.strokeStyle = "#59c2ff";
    context.lineWidth = 2 * this.unit;
    context.setLineDash([7 * this.unit, 6 * this.unit]);
    context.beginPath();
    context.moveTo(from[0], from[1]);
    context.lineTo(to[0], to[1]);
    context.stroke();
    context.setLineDash([]);
    context.beginPath();
    context.arc(from[0], from[1], 7 * this.unit, 0, 2 * Math.PI);
    context.stroke();
  }
}

// Put the chamber with its buttons into `place`.
export function showChamber(place) {
  const canvas = html("canvas", {
    tabindex: 0,
    role: "img",
    "aria-label": "The chamber in 3-D. Arrow keys turn it, plus and minus zoom, Home resets. The table names each object.",
  });
  const words = html("p", { class: "small" }, "Yellow: where the scanner went. Dashed blue: from where to look next. The white share of a ring is the belief.");
  place.replaceChildren(canvas);
  const view = new Chamber3d(canvas);
  place.append(view.buttons("Turn the map"), words);
  new ResizeObserver(() => view.draw()).observe(place);
  return view;
}
