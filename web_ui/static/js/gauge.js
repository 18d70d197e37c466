// The gauge of trust: a half circle filled from left to right.

import { svg } from "./dom.js";

const LENGTH = Math.PI * 50;
const ARC = "M 10 60 A 50 50 0 0 1 110 60";

export function gauge(trust, level) {
  const known = typeof trust === "number" && Number.isFinite(trust);
  const share = known ? Math.min(Math.max(trust, 0), 1) : 0;
  const text = known ? `${Math.round(share * 100)} %` : "–";
  const stroke = { d: ARC, fill: "none", "stroke-width": 14, "stroke-linecap": "butt" };
  const label = known ? `Trust ${Math.round(share * 100)} percent` : "Trust not known";
  return svg("svg", { class: "gauge", viewBox: "0 0 120 66", role: "img", "aria-label": label, "data-level": level }, [
    svg("path", { ...stroke, class: "track" }),
    svg("path", { ...stroke, class: "value", "stroke-dasharray": `${(share * LENGTH).toFixed(1)} ${(LENGTH + 10).toFixed(1)}` }),
    svg("text", { x: 60, y: 58, "text-anchor": "middle" }, text),
  ]);
}
