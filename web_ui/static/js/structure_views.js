// What both pages of a chamber show of its map: 3-D, what is uncertain, connections as a graph and as a table.

import { byId, html, setText, svg } from "./dom.js";
import { CLASSES, SURE, showChamber } from "./structure3d.js";

const GRAPH = { width: 520, height: 400, margin: 34, disc: 14, least: 40 };
const SURE_EDGE = 0.9;

const percent = (share) => (share > 0.99 ? "> 99 %" : `${Math.round(100 * share)} %`);
const metres = (value) => value.toFixed(2);

export const naming = (thing) => `${thing.class[0].toUpperCase()}${thing.class.slice(1)} ${thing.number}`;

function stateOf(thing) {
  if (thing.open === null) return "";
  return thing.open ? ", open" : ", closed";
}

// Objects seen obliquely, pushed apart until no two lie on each other.
export function layout(objects, { width, height, margin, least } = GRAPH) {
  if (!objects.length) return new Map();
  const flat = objects.map(({ position: [north, east, down] }) => [east + 0.45 * north, down - 0.35 * north]);
  const range = [0, 1].map((i) => [Math.min(...flat.map((p) => p[i])), Math.max(...flat.map((p) => p[i]))]);
  const scale = Math.min(...range.map(([a, b], i) => ([width, height][i] - 2 * margin) / Math.max(b - a, 0.2)));
  const places = flat.map((p) => p.map((value, i) => [width, height][i] / 2 + (value - (range[i][0] + range[i][1]) / 2) * scale));
  for (let turn = 0; turn < 60; turn += 1) {
    for (let i = 0; i < places.length; i += 1) {
      for (let j = 0; j < i; j += 1) {
        const [dx, dy] = [places[i][0] - places[j][0], places[i][1] - places[j][1]];
        const far = Math.hypot(dx, dy);
        if (far >= least) continue;
        const [ux, uy] = far > 1e-6 ? [dx / far, dy / far] : [1, 0];
        const push = (least - far) / 2;
        places[i] = [places[i][0] + ux * push, places[i][1] + uy * push];
        places[j] = [places[j][0] - ux * push, places[j][1] - uy * push];
      }
    }
    for (const place of places) {
      place[0] = Math.min(Math.max(place[0], margin), width - margin);
      place[1] = Math.min(Math.max(place[1], margin), height - margin);
    }
  }
  return new Map(objects.map((thing, k) => [thing.number, places[k]]));
}

// The pieces of pipe between neighbours: [pipe, object, object, belief]; a pipe with one object alone gives none.
export function pieces(map) {
  return map.pipes.flatMap((pipe) => {
    const on = map.edges.filter((edge) => edge.pipe === pipe.number).sort((a, b) => a.along_m - b.along_m);
    return on.slice(1).map((edge, k) => [pipe.number, on[k].object, edge.object, Math.min(edge.belief, on[k].belief)]);
  });
}

export class StructureViews {
  constructor() {
    this.chamber = showChamber(byId("chamber3d"));
    byId("chamber-legend").replaceChildren(
      ...Object.entries(CLASSES).map(([name, { color, letter }]) => {
        const swatch = html("span", { class: "swatch", "aria-hidden": "true" }, letter);
        swatch.style.background = color;
        return html("li", {}, [swatch, name]);
      }),
    );
  }

  show(map) {
    this.chamber.set(map);
    setText(byId("chamber-count"), `${map.pipes.length} pipes, ${map.objects.length} objects, ${map.edges.length} connections`);
    this.uncertain(map);
    this.table(map);
    this.graph(map);
  }

  uncertain(map) {
    const named = new Map(map.objects.map((thing) => [thing.number, naming(thing)]));
    byId("unsure").replaceChildren(
      ...map.uncertain.map((one) => {
        const what = one.kind === "object" ? `${named.get(one.object)}: ${one.classes.join(" or ")}` : `Whether ${named.get(one.object)} sits on pipe ${one.pipe}`;
        return html("li", {}, [html("span", {}, what), html("span", { class: "share" }, percent(one.belief))]);
      }),
    );
    byId("unsure-nothing").hidden = map.uncertain.length > 0;
    byId("next-view").hidden = !map.next_view;
    if (map.next_view) setText(byId("next-view-text"), map.next_view.prompt);
  }

  table(map) {
    byId("chamber-rows").replaceChildren(
      ...map.objects.map((thing) => {
        const pipes = map.edges.filter((edge) => edge.object === thing.number).map((edge) => (edge.belief < SURE_EDGE ? `${edge.pipe}?` : String(edge.pipe)));
        return html("tr", {}, [
          html("th", { scope: "row" }, String(thing.number)),
          html("td", {}, thing.class + stateOf(thing)),
          html("td", {}, percent(thing.belief)),
          html("td", {}, pipes.join(", ") || "–"),
          html("td", {}, `${thing.position.map(metres).join(", ")} m`),
        ]);
      }),
    );
  }

  graph(map) {
    const places = layout(map.objects);
    const element = byId("chamber-graph");
    element.setAttribute("viewBox", `0 0 ${GRAPH.width} ${GRAPH.height}`);
    const lines = [];
    const names = [];
    for (const [pipe, one, other, belief] of pieces(map)) {
      const [a, b] = [places.get(one), places.get(other)];
      if (!a || !b) continue;
      lines.push(svg("line", { class: "edge", "data-sure": belief < SURE_EDGE ? "no" : "yes", x1: a[0], y1: a[1], x2: b[0], y2: b[1] }));
      const label = svg("text", { class: "pipe-name", x: (a[0] + b[0]) / 2, y: (a[1] + b[1]) / 2 });
      label.textContent = String(pipe);
      names.push(label);
    }
    const discs = map.objects.flatMap((thing) => {
      const [x, y] = places.get(thing.number);
      const { color, letter } = CLASSES[thing.class] ?? { color: "#d5dbe1", letter: "?" };
      const disc = svg("circle", { cx: x, cy: y, r: GRAPH.disc, fill: color });
      const text = svg("text", { x, y });
      text.textContent = `${letter}${thing.number}`;
      const ring = thing.belief < SURE ? [svg("circle", { class: "unsure-ring", cx: x, cy: y, r: GRAPH.disc + 4 })] : [];
      return [disc, ...ring, text];
    });
    element.replaceChildren(...lines, ...names, ...discs);
  }
}
