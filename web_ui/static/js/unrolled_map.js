// The unrolled map: the pipe cut open at the invert and laid flat, 6 at both edges, the crown (12) in the middle.
// On a wide screen the chainage runs to the right, on a tall one downwards. Only the chainage zooms; the whole clock always shows.

import { svg } from "./dom.js";
import { chainageText, isExtent, metresText, sigmaOf, slug, spoken, symbol } from "./drive_words.js";

const HOURS = [6, 7, 8, 9, 10, 11, 12, 1, 2, 3, 4, 5, 6];
const ELLIPSE = 2.448; // 95 % of a normal distribution in two dimensions: sqrt(5.991)
const LEAST_SPAN_M = 1;
const FOLLOW_SPAN_M = 12;
const STEP = 0.25;
const TAP_PX = 8;
const REACH_PX = 26;
const STEPS_M = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200];

// Share of the way from edge to edge at which a clock position lies.
export const across = (hour) => ((hour + 6) % 12) / 12;

// The parts of a stretch of `reach` hours from `hour` on, as shares; what crosses the cut is in two parts.
export function parts(hour, reach) {
  const from = across(hour);
  const to = from + reach / 12;
  return to <= 1 ? [[from, to]] : [[from, 1], [0, to - 1]];
}

// What a view shows: a stretch of the chainage, kept within what there is and no shorter than a metre.
export function clampView({ from, to }, { low, high }) {
  const span = Math.min(Math.max(to - from, LEAST_SPAN_M), Math.max(high - low, LEAST_SPAN_M));
  const start = Math.min(Math.max((from + to - span) / 2, low), Math.max(high - span, low));
  return { from: start, to: start + span };
}

export function bounds({ landmarks, rings, crawler, from, to }) {
  const places = landmarks.flatMap((view) => [view.chainage_m, view.chainage_to_m]);
  for (const ring of rings) places.push(ring.chainage_m);
  for (const place of [crawler, from, to]) if (place !== null && place !== undefined) places.push(place);
  if (!places.length) return { low: 0, high: 10 };
  const [least, most] = places.reduce(([a, b], place) => [Math.min(a, place), Math.max(b, place)], [Infinity, -Infinity]);
  const margin = Math.max((most - least) * 0.02, 0.25);
  return { low: least < 0 ? least - margin : Math.max(least - margin, 0), high: Math.max(most + margin, least + 2) };
}

export class UnrolledMap {
  // onPick(id) is called when a landmark is tapped, onMove() when the operator moved the map.
  constructor(place, { onPick, onMove = () => {} }) {
    Object.assign(this, { place, onPick, onMove });
    this.content = { landmarks: [], rings: [], crawler: null, sigma: null, from: null, to: null };
    this.view = null; // null: all there is
    this.following = false;
    this.pointers = new Map();
    this.svg = svg("svg", { class: "unrolled", tabindex: 0, role: "img", "aria-label": "Unrolled map" });
    place.replaceChildren(this.svg);
    this.listen();
    new ResizeObserver(() => this.draw()).observe(place);
  }

  set(content) {
    Object.assign(this.content, content);
    this.draw();
  }

  get empty() {
    const { landmarks, rings, crawler, to } = this.content;
    return !landmarks.length && !rings.length && crawler === null && (to === null || to === undefined);
  }

  get range() {
    return bounds(this.content);
  }

  get window() {
    if (this.following && this.content.crawler !== null) {
      const span = this.view ? this.view.to - this.view.from : FOLLOW_SPAN_M;
      return clampView({ from: this.content.crawler - span * 0.8, to: this.content.crawler + span * 0.2 }, this.followRange(span));
    }
    return this.view ? clampView(this.view, this.range) : { from: this.range.low, to: this.range.high };
  }

  // While following there is always a stretch ahead of the crawler, however short the way so far.
  followRange(span) {
    const { low, high } = this.range;
    return { low, high: Math.max(high, this.content.crawler + span * 0.2, low + span) };
  }

  // --- what the operator does ----------------------------------------------------------------------------------------------------

  zoom(factor, at = 0.5) {
    const { from, to } = this.window;
    const span = (to - from) / factor;
    const fixed = from + (to - from) * at;
    const whole = this.range.high - this.range.low;
    this.view = span >= whole && !this.following ? null : { from: fixed - span * at, to: fixed + span * (1 - at) };
    this.moved();
  }

  pan(metres) {
    const { from, to } = this.window;
    this.following = false;
    this.view = clampView({ from: from + metres, to: to + metres }, this.range);
    this.moved();
  }

  whole() {
    this.view = null;
    this.following = false;
    this.moved();
  }

  follow(wanted) {
    const { from, to } = this.window;
    this.following = wanted;
    this.view = wanted ? null : { from, to };
    this.moved();
  }

  show(view) {
    const { from, to } = this.window;
    const middle = (view.chainage_m + view.chainage_to_m) / 2;
    if (middle >= from && middle <= to) return;
    this.following = false;
    this.view = { from: middle - (to - from) / 2, to: middle + (to - from) / 2 };
    this.moved();
  }

  moved() {
    this.draw();
    this.onMove();
  }

  listen() {
    const { svg: element } = this;
    const along = (event) => {
      const box = element.getBoundingClientRect();
      const { left, top, length } = this.frame;
      return ((this.tall ? event.clientY - box.top - top : event.clientX - box.left - left)) / length;
    };
    element.addEventListener("pointerdown", (event) => {
      this.pointers.set(event.pointerId, { at: along(event), x: event.clientX, y: event.clientY, far: 0 });
      element.setPointerCapture(event.pointerId);
    });
    element.addEventListener("pointermove", (event) => {
      const last = this.pointers.get(event.pointerId);
      if (!last) return;
      const at = along(event);
      const far = last.far + Math.hypot(event.clientX - last.x, event.clientY - last.y);
      const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, pointer]) => pointer);
      this.pointers.set(event.pointerId, { at, x: event.clientX, y: event.clientY, far });
      const { from, to } = this.window;
      if (others.length) {
        const [before, after] = [Math.abs(last.at - others[0].at), Math.abs(at - others[0].at)];
        if (before > 0.02 && after > 0.02) this.zoom(after / before, (at + others[0].at) / 2);
        others[0].far += TAP_PX; // two fingers never tap
      } else if (far > TAP_PX && this.canPan) this.pan((last.at - at) * (to - from));
    });
    element.addEventListener("pointerup", (event) => {
      const pointer = this.pointers.get(event.pointerId);
      this.pointers.delete(event.pointerId);
      if (pointer && pointer.far <= TAP_PX && !this.pointers.size) this.tap(event);
    });
    element.addEventListener("pointercancel", (event) => this.pointers.delete(event.pointerId));
    element.addEventListener(
      "wheel",
      (event) => {
        if (!event.ctrlKey && !event.shiftKey && this.tall && !this.canPan) return; // the page scrolls
        event.preventDefault();
        this.zoom(Math.exp(-event.deltaY / 400), Math.min(Math.max(along(event), 0), 1));
      },
      { passive: false },
    );
    element.addEventListener("keydown", (event) => {
      const { from, to } = this.window;
      const back = event.key === "ArrowLeft" || event.key === "ArrowUp";
      if (back || event.key === "ArrowRight" || event.key === "ArrowDown") this.pan((back ? -STEP : STEP) * (to - from));
      else if (event.key === "+" || event.key === "=") this.zoom(1.5);
      else if (event.key === "-") this.zoom(1 / 1.5);
      else if (event.key === "Home") this.whole();
      else return;
      event.preventDefault();
    });
  }

  get canPan() {
    const { from, to } = this.window;
    return to - from < this.range.high - this.range.low - 1e-6;
  }

  // The nearest landmark within a finger's reach; an area counts over all of it.
  tap(event) {
    const box = this.svg.getBoundingClientRect();
    const [x, y] = [event.clientX - box.left, event.clientY - box.top];
    let [best, least] = [null, REACH_PX];
    for (const { id, spots, areas } of this.hits ?? []) {
      let far = Infinity;
      for (const spot of spots) far = Math.min(far, Math.hypot(spot[0] - x, spot[1] - y));
      for (const [left, top, width, height] of areas)
        far = Math.min(far, 4 + Math.hypot(Math.max(left - x, 0, x - left - width), Math.max(top - y, 0, y - top - height)));
      if (far < least) [best, least] = [id, far];
    }
    if (best !== null) this.onPick(best);
  }

  // --- drawing ----------------------------------------------------------------------------------------------------------------------

  // For the printer: all of it, lying down, in ink on paper; then back.
  print(on) {
    this.printing = on;
    this.draw();
  }

  draw() {
    const width = this.printing ? 1000 : Math.round(this.place.clientWidth);
    if (width < 50) return;
    this.tall = !this.printing && width < 640;
    const height = this.printing ? 420 : this.tall ? Math.round(Math.min(Math.max(window.innerHeight * 0.6, 320), 620)) : 340;
    this.frame = this.tall ? { left: 40, top: 24, length: height - 36, breadth: width - 52 } : { left: 40, top: 12, length: width - 52, breadth: height - 42 };
    const { from, to } = this.printing ? { from: this.range.low, to: this.range.high } : this.window;
    const { left, top, length, breadth } = this.frame;
    const scale = length / (to - from);
    const along = (metres) => (metres - from) * scale;
    const point = (metres, share) => (this.tall ? [left + share * breadth, top + along(metres)] : [left + along(metres), top + share * breadth]);
    const line = (name, a, b) => svg("path", { class: name, d: `M ${a.map(round).join(" ")} L ${b.map(round).join(" ")}` });
    const area = (metres, share, long, broad) => {
      const [x, y] = point(metres, share);
      return this.tall ? [x, y, broad * breadth, long * scale] : [x, y, long * scale, broad * breadth];
    };
    const rect = (name, [x, y, w, h]) => svg("rect", { class: name, x: round(x), y: round(y), width: round(Math.max(w, 1)), height: round(Math.max(h, 1)) });

    const inside = [rect("wall", area(from, 0, to - from, 1))];
    const outside = [];
    for (const [index, hour] of HOURS.entries()) {
      inside.push(line(hour % 3 === 0 ? "clock-line strong" : "clock-line", point(from, index / 12), point(to, index / 12)));
      if (hour % 3 && breadth < 320) continue;
      const [x, y] = point(from, index / 12);
      const place = this.tall ? { x: round(x), y: top - 8, "text-anchor": "middle" } : { x: left - 8, y: round(y + 4.5), "text-anchor": "end" };
      outside.push(svg("text", { class: hour % 3 ? "quiet" : "", ...place }, String(hour)));
    }
    const room = this.tall ? 44 : 64;
    const step = STEPS_M.find((candidate) => candidate * scale >= room) ?? STEPS_M.at(-1);
    for (let k = Math.ceil(from / step - 1e-9); k * step <= to + 1e-9; k += 1) {
      const metres = k * step;
      inside.push(line("metre-line", point(metres, 0), point(metres, 1)));
      const [x, y] = point(metres, this.tall ? 0 : 1);
      const text = metres.toFixed(step < 1 ? 1 : 0);
      const place = this.tall ? { x: left - 6, y: round(y + 4.5), "text-anchor": "end" } : { x: round(x), y: round(y + 20), "text-anchor": "middle" };
      outside.push(svg("text", place, text));
    }
    const joint = this.content.rings.length * 14 > (this.range.high - this.range.low) * scale ? "joint dense" : "joint";
    for (const ring of this.content.rings) {
      if (ring.chainage_m < from || ring.chainage_m > to) continue;
      inside.push(line(joint, point(ring.chainage_m, 0), point(ring.chainage_m, 1)));
    }
    this.hits = [];
    const tags = [];
    const taken = [];
    for (const view of this.content.landmarks) {
      const margin = 20 / scale;
      if (view.chainage_to_m < from - margin || view.chainage_m > to + margin) continue;
      const group = this.mark(view, { point, area, rect, scale, breadth, line });
      inside.push(group.element);
      this.hits.push(group);
      if (!view.rejected) tags.push([view, group]);
    }
    for (const [view, { spots }] of tags) {
      const text = `${view.id}`;
      const [x, y] = spots[0];
      const half = 4.5 * text.length + 2;
      const turn = x + 15 + 2 * half > left + (this.tall ? breadth : length);
      const box = [turn ? x - 13 - 2 * half : x + 13, y - 8, 2 * half, 16];
      if (taken.some(([a, b, c, d]) => box[0] < a + c && a < box[0] + box[2] && box[1] < b + d && b < box[1] + box[3])) continue;
      taken.push(box);
      inside.push(svg("text", { class: "tag", x: round(turn ? x - 13 : x + 13), y: round(y + 5), "text-anchor": turn ? "end" : "start" }, text));
    }
    const { crawler, sigma } = this.content;
    if (crawler !== null && crawler >= from && crawler <= to) {
      if (sigma) inside.push(rect("crawler-band", area(crawler - 1.96 * sigma, 0, 3.92 * sigma, 1)));
      inside.push(line("crawler", point(crawler, 0), point(crawler, 1)));
      const [x, y] = point(crawler, 0.5);
      const arrow = this.tall ? `M ${round(x - 11)} ${round(y - 7)} h 22 l -11 16 z` : `M ${round(x - 7)} ${round(y - 11)} v 22 l 16 -11 z`;
      inside.push(svg("path", { class: "crawler-arrow", d: arrow }));
    }
    // Symbols at the edges stick out by half their size; what has scrolled away does not.
    const clip = svg("clipPath", { id: "map-clip" }, rect("", this.tall ? [left - 11, top - 1, breadth + 22, length + 2] : [left - 1, top - 11, length + 2, breadth + 22]));
    this.svg.replaceChildren(svg("defs", {}, clip), svg("g", { "clip-path": "url(#map-clip)" }, inside), ...outside);
    for (const [name, value] of Object.entries({ viewBox: `0 0 ${width} ${height}`, width, height })) this.svg.setAttribute(name, value);
    this.svg.classList.toggle("zoomed", this.canPan || this.following);
    const landmarks = this.content.landmarks.filter((view) => !view.rejected);
    const label = `Unrolled map, ${metresText(from, 1)} to ${metresText(to, 1)} metres, ${landmarks.length} landmarks, ${this.content.rings.length} joints. Arrow keys move it, plus and minus zoom, Home shows all. The list names each landmark.`;
    if (this.svg.getAttribute("aria-label") !== label) this.svg.setAttribute("aria-label", label);
  }

  mark(view, { point, area, rect, scale, breadth, line }) {
    const children = [];
    const areas = [];
    const spots = [];
    const middleM = (view.chainage_m + view.chainage_to_m) / 2;
    if (view.clock === null) {
      children.push(line("unknown-clock", point(middleM, 0), point(middleM, 1)));
      spots.push(point(middleM, 0.5));
    } else {
      if (isExtent(view)) {
        for (const [a, b] of parts(view.clock, view.reach)) {
          const place = area(view.chainage_m, a, view.chainage_to_m - view.chainage_m, b - a);
          children.push(rect("extent", place));
          areas.push(place);
        }
      }
      const share = across((view.clock + view.reach / 2) % 12);
      // An area across the cut has its symbol in both parts; what is at a point on the cut is drawn at both edges.
      const split = isExtent(view) ? parts(view.clock, view.reach) : [];
      const shares = split.length > 1 ? split.map(([a, b]) => (a + b) / 2) : share < 0.03 ? [share, share + 1] : share > 0.97 ? [share, share - 1] : [share];
      for (const one of shares) {
        const [x, y] = point(middleM, one);
        spots.push([x, y]);
        if (split.length < 2 && sigmaOf(view) !== null && view.sigma_clock !== null) {
          const [long, broad] = [ELLIPSE * sigmaOf(view) * scale, (ELLIPSE * view.sigma_clock * breadth) / 12];
          const [rx, ry] = this.tall ? [broad, long] : [long, broad];
          children.push(svg("ellipse", { class: "doubt", cx: round(x), cy: round(y), rx: round(rx), ry: round(ry) }));
        }
      }
    }
    for (const [x, y] of spots) children.push(svg("use", { href: `#icon-${symbol(view.class)}`, x: round(x - 10), y: round(y - 10), width: 20, height: 20 }));
    children.push(svg("title", {}, `${view.id}: ${spoken(view)}, ${chainageText(view)}`));
    const element = svg("g", { class: `landmark ${slug(view.class)}`, "data-id": view.id, "data-status": view.status, "data-rejected": view.rejected ? "yes" : "no" }, children);
    return { id: view.id, element, spots, areas };
  }
}

const round = (value) => Math.round(value * 10) / 10;
