// The fitted circle over the depth picture: polylines in fractions of its width and height, white in a dark case to stand on any colour.

import { setData, svg } from "./dom.js";

export function drawOverlay(layer, polylines, level) {
  setData(layer, "level", level);
  const lines = (polylines ?? []).map((line) => line.map(([x, y]) => `${x.toFixed(4)},${y.toFixed(4)}`).join(" "));
  const wanted = lines.length * 2;
  while (layer.childElementCount > wanted) layer.lastElementChild.remove();
  while (layer.childElementCount < wanted) layer.append(svg("polyline", { class: layer.childElementCount % 2 ? "line" : "case" }));
  lines.forEach((points, index) => {
    layer.children[2 * index].setAttribute("points", points);
    layer.children[2 * index + 1].setAttribute("points", points);
  });
}
