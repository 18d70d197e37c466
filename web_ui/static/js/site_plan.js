// The plan of a site: its manholes where their coordinates say, pipes as arrows with the flow.

import { svg } from "./dom.js";

const MARGIN = 48;
const HEIGHT = { least: 160, most: 560 };

const placed = (node) => Boolean(node) && node.easting !== null && node.northing !== null;

// 1, 2 or 5 times a power of ten: the longest bar within a third of the width.
function barOf(metres) {
  const power = 10 ** Math.floor(Math.log10(metres));
  return [5, 2, 1].map((times) => times * power).find((length) => length <= metres);
}

// Draws into `plan`, as wide as what holds it, and returns whether there was anything to draw.
export function drawPlan(plan, nodes, pipes) {
  const shown = nodes.filter(placed);
  if (!shown.length) return false;
  plan.removeAttribute("hidden");
  const width = plan.getBoundingClientRect().width;
  const [east, north] = [shown.map((node) => node.easting), shown.map((node) => node.northing)];
  const [west, top] = [Math.min(...east), Math.max(...north)];
  const span = Math.max(Math.max(...east) - west, 1);
  const rise = top - Math.min(...north);
  const scale = Math.min((width - 2 * MARGIN) / span, rise ? (HEIGHT.most - 2 * MARGIN) / rise : Infinity);
  const height = Math.max(HEIGHT.least, rise * scale + 2 * MARGIN);
  const at = (node) => [MARGIN + (node.easting - west) * scale, MARGIN + (top - node.northing) * scale];
  const byNumber = new Map(nodes.map((node) => [node.id, node]));

  plan.setAttribute("viewBox", `0 0 ${width} ${height}`);
  const arrow = svg("marker", { id: "flow", viewBox: "0 0 10 10", refX: 9, refY: 5, markerWidth: 5, markerHeight: 5, orient: "auto" }, [svg("path", { d: "M0 0L10 5L0 10z" })]);
  const parts = [svg("defs", {}, [arrow])];
  for (const pipe of pipes) {
    const [from, to] = [byNumber.get(pipe.start_node), byNumber.get(pipe.end_node)];
    if (!placed(from) || !placed(to)) continue;
    const [[x1, y1], [x2, y2]] = [at(from), at(to)];
    const long = Math.hypot(x2 - x1, y2 - y1) || 1;
    const [dx, dy] = [(9 * (x2 - x1)) / long, (9 * (y2 - y1)) / long]; // the arrow ends at the manhole's rim
    parts.push(svg("line", { x1, y1, x2: x2 - dx, y2: y2 - dy, "marker-end": "url(#flow)" }));
    parts.push(svg("text", { class: "pipe-name", x: (x1 + x2) / 2, y: (y1 + y2) / 2 - 6 }, [pipe.name]));
  }
  for (const node of shown) {
    const [cx, cy] = at(node);
    const right = cx > width / 2; // names go inwards, where there is room for them
    const name = svg("text", { x: right ? cx - 11 : cx + 11, y: cy + 18, "text-anchor": right ? "end" : "start" }, [node.name]);
    parts.push(svg("circle", { cx, cy, r: 7 }), name);
  }
  const bar = barOf((width - 2 * MARGIN) / 3 / scale);
  parts.push(svg("line", { class: "scale", x1: 12, y1: height - 10, x2: 12 + bar * scale, y2: height - 10 }));
  parts.push(svg("text", { x: 18 + bar * scale, y: height - 6 }, [`${bar} m, north up`]));
  plan.replaceChildren(...parts);
  return true;
}
