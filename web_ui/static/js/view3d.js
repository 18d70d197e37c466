// What is shown in 3-D on a plain 2-D canvas: turned by drag, keys or buttons, magnified by two fingers, wheel or keys.

import { html } from "./dom.js";

const STEP = 0.16;
const TAP_PX = 6;

export const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
export const unit = (a) => a.map((part) => part / (Math.hypot(...a) || 1));

// Two directions that stand square on `axis` (a unit vector) and on each other.
export function square(axis) {
  const u = unit(cross(axis, Math.abs(axis[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0]));
  return [u, cross(axis, u)];
}

// The centre of points and their largest extent.
export function boundsOf(points) {
  const range = [0, 1, 2].map((i) => points.reduce(([a, b], p) => [Math.min(a, p[i]), Math.max(b, p[i])], [Infinity, -Infinity]));
  return { centre: range.map(([a, b]) => (a + b) / 2), size: Math.max(...range.map(([a, b]) => b - a)) };
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

// A view draws itself (`draw`), and may listen to taps (`tap(x, y)`, canvas points) and further keys (`key(name)`, true if used).
export class View3d {
  constructor(canvas, { yaw, pitch, zoom = 1, ratio = 0.75 }) {
    Object.assign(this, { canvas, ratio, begin: { yaw, pitch, zoom }, yaw, pitch, zoom, pointers: new Map() });
    canvas.addEventListener("pointerdown", (event) => {
      this.pointers.set(event.pointerId, { x: event.clientX, y: event.clientY, far: 0 });
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => this.moved(event));
    canvas.addEventListener("pointerup", (event) => this.lifted(event));
    canvas.addEventListener("pointercancel", (event) => this.pointers.delete(event.pointerId));
    canvas.addEventListener(
      "wheel",
      (event) => {
        event.preventDefault();
        this.magnify(Math.exp(-event.deltaY / 500));
      },
      { passive: false },
    );
    canvas.addEventListener("keydown", (event) => {
      const action = { ArrowLeft: [-STEP, 0], ArrowRight: [STEP, 0], ArrowUp: [0, -STEP], ArrowDown: [0, STEP] }[event.key];
      if (action) this.turn(...action);
      else if (event.key === "+" || event.key === "=") this.magnify(1.2);
      else if (event.key === "-") this.magnify(1 / 1.2);
      else if (event.key === "Home") this.home();
      else if (!this.key?.(event.key)) return;
      event.preventDefault();
    });
  }

  moved(event) {
    const last = this.pointers.get(event.pointerId);
    if (!last) return;
    const now = { x: event.clientX, y: event.clientY };
    now.far = last.far + Math.hypot(now.x - last.x, now.y - last.y);
    this.pointers.set(event.pointerId, now);
    const other = [...this.pointers].find(([id]) => id !== event.pointerId)?.[1];
    if (other) {
      const [before, after] = [last, now].map((p) => Math.hypot(p.x - other.x, p.y - other.y));
      if (before > 10) this.magnify(after / before);
      other.far += 99; // two fingers never tap
    } else if (now.far > TAP_PX) this.turn((now.x - last.x) / 140, (now.y - last.y) / 140);
  }

  lifted(event) {
    const pointer = this.pointers.get(event.pointerId);
    this.pointers.delete(event.pointerId);
    if (!this.tap || !pointer || pointer.far > TAP_PX || this.pointers.size) return;
    const box = this.canvas.getBoundingClientRect();
    const scale = this.canvas.width / box.width;
    this.tap((event.clientX - box.left) * scale, (event.clientY - box.top) * scale);
  }

  home() {
    Object.assign(this, this.begin);
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

  // As many points as the screen has, up to two for each of its own; `unit` is one point of the screen in those of the canvas.
  fit() {
    const wide = Math.max(this.canvas.clientWidth, 240);
    this.unit = Math.min(window.devicePixelRatio || 1, 2);
    const [width, height] = [Math.round(wide * this.unit), Math.round(wide * this.unit * this.ratio)];
    if (this.canvas.width !== width || this.canvas.height !== height) Object.assign(this.canvas, { width, height });
  }

  // The buttons for whoever has neither mouse nor keys; `words` says what they turn.
  buttons(words) {
    const button = (text, label, action) => {
      const element = html("button", { type: "button", class: "button quiet", "aria-label": label }, text);
      element.addEventListener("click", action);
      return element;
    };
    return html("div", { class: "cloud-buttons", role: "group", "aria-label": words }, [
      button("◀", "Turn left", () => this.turn(-STEP * 2, 0)),
      button("▶", "Turn right", () => this.turn(STEP * 2, 0)),
      button("▲", "Turn up", () => this.turn(0, -STEP * 2)),
      button("▼", "Turn down", () => this.turn(0, STEP * 2)),
      button("+", "Closer", () => this.magnify(1.3)),
      button("−", "Farther", () => this.magnify(1 / 1.3)),
    ]);
  }
}
