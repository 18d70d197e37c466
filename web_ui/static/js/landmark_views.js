// The landmarks of one drive as map, list, 3-D pipe and panel: one set of landmarks behind all four.

import { byId, html, icon, setText } from "./dom.js";
import { sentence, shown, symbol } from "./drive_words.js";
import { LandmarkList } from "./landmark_list.js";
import { LandmarkPanel } from "./landmark_panel.js";
import { UnrolledMap } from "./unrolled_map.js";

const USUAL_RADIUS_M = 0.15; // of a pipe whose radius nobody has stated

export class LandmarkViews {
  constructor({ surveyId, live = false }) {
    this.surveyId = surveyId;
    this.onDraw = () => {};
    this.landmarks = new Map();
    this.rings = [];
    this.radius = null;
    this.place = { crawler: null, sigma: null, from: null, to: null };
    this.panel = new LandmarkPanel({ surveyId: () => this.surveyId, onChange: (landmark) => this.change([landmark]) });
    this.map = new UnrolledMap(byId("map"), { onPick: (id) => this.open(id), onMove: () => this.moved() });
    this.list = new LandmarkList({ surveyId, onPick: (id) => this.open(id), newestFirst: live });
    byId("map-in").addEventListener("click", () => this.map.zoom(1.6));
    byId("map-out").addEventListener("click", () => this.map.zoom(1 / 1.6));
    byId("map-whole").addEventListener("click", () => this.map.whole());
    byId("map-follow")?.addEventListener("click", () => this.map.follow(!this.map.following));
    byId("map-print")?.addEventListener("click", () => window.print());
    window.addEventListener("beforeprint", () => this.map.print(true));
    window.addEventListener("afterprint", () => this.map.print(false));
    byId("pipe3d-show").addEventListener("click", () => this.openPipe());
    if (live) this.map.follow(true);
    this.moved();
  }

  get views() {
    return [...this.landmarks.values()].map(shown).sort((a, b) => a.chainage_m - b.chainage_m || a.id - b.id);
  }

  // Another drive: nothing of the last one stays.
  restart(surveyId) {
    this.surveyId = surveyId;
    this.list.surveyId = surveyId;
    this.list.rows.clear();
    this.landmarks.clear();
    this.rings = [];
    this.place = { crawler: null, sigma: null, from: null, to: null };
    this.draw();
  }

  // A whole map as the box keeps it.
  load(map) {
    this.rings = map.rings ?? [];
    this.radius = map.radius_m ?? null;
    Object.assign(this.place, { from: map.from_m, to: map.to_m });
    for (const landmark of map.landmarks) this.landmarks.set(landmark.id, landmark);
    this.draw();
  }

  change(landmarks, gone = []) {
    for (const landmark of landmarks) {
      this.landmarks.set(landmark.id, landmark);
      this.panel.update(landmark);
    }
    for (const id of gone) this.landmarks.delete(id);
    if (landmarks.length || gone.length) this.draw();
  }

  crawler(metres, sigma) {
    if (this.place.crawler === metres) return;
    Object.assign(this.place, { crawler: metres, sigma });
    this.map.set({ ...this.place });
  }

  open(id) {
    const landmark = this.landmarks.get(id);
    if (!landmark) return;
    this.map.show(shown(landmark));
    this.panel.open(landmark);
  }

  draw() {
    const views = this.views;
    this.map.set({ landmarks: views, rings: this.rings, ...this.place });
    this.list.set(views);
    this.legend(views);
    this.pipe?.set(this.pipeContent());
    this.moved();
    this.onDraw();
  }

  legend(views) {
    const names = [...new Set(views.map((view) => view.class))].sort();
    const key = `${names} ${this.rings.length > 0}`;
    if (key === this.legendKey) return;
    this.legendKey = key;
    const rows = names.map((name) => html("li", { "data-class": symbol(name).slice(3) }, [icon(symbol(name)), sentence(name)]));
    if (this.rings.length) rows.push(html("li", { class: "legend-joint" }, "Joint"));
    if (names.length) rows.push(html("li", { class: "legend-doubt" }, "95 % sure"));
    byId("legend").replaceChildren(...rows);
  }

  moved() {
    const { from, to } = this.map.window;
    setText(byId("map-scale"), this.map.empty ? "" : `${from.toFixed(1)} to ${to.toFixed(1)} m`);
    byId("map-follow")?.setAttribute("aria-pressed", String(this.map.following));
  }

  pipeContent() {
    return { landmarks: this.views, rings: this.rings, radius: this.radius ?? USUAL_RADIUS_M, range: this.map.range, crawler: this.place.crawler };
  }

  async openPipe() {
    const button = byId("pipe3d-show");
    const place = byId("pipe3d");
    button.disabled = true;
    place.hidden = false;
    place.replaceChildren(html("p", {}, "Loading the pipe …"));
    try {
      const { showPipe } = await import("./pipe3d.js");
      this.pipe = showPipe(place, this.pipeContent(), (id) => this.open(id));
      button.hidden = true;
      place.querySelector("canvas").focus();
    } catch (error) {
      place.replaceChildren(html("p", { class: "failed" }, error.message));
      button.disabled = false;
    }
  }
}
