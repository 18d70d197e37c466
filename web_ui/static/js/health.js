// The strip in the top bar: cameras, storage and clock, worst news first.

import { byId, html, icon, setData, setIcon, setText } from "./dom.js";
import { CAMERAS, CLOCKS, SHORT, age } from "./words.js";

const LOW_MB = 1000;
const FULL_MB = 200;
const TOLD = ["disk_low", "clock_unset"]; // by the rows of storage and clock
const RANK = { good: 0, fair: 1, bad: 2 };

const space = (megabytes) => (megabytes >= 1000 ? `${(megabytes / 1000).toFixed(1)} GB` : `${Math.round(megabytes)} MB`);

const concern = (prompt) => ({ state: "fair", icon: "warning", short: SHORT[prompt.code] ?? "Box", title: prompt.reason, detail: prompt.remedy });

export function healthItems(status) {
  const cameras = status.cameras.map((camera) => {
    const known = CAMERAS[camera.state] ?? { word: camera.state, state: "fair", icon: "warning" };
    const numbers = `${camera.fps.toFixed(0)} frames/s, last good frame ${age(camera.age_s)} ago, ${camera.drops} dropped, ${camera.bad_frames} bad, ${camera.reconnects} reconnects`;
    return {
      ...known,
      short: known.state === "good" ? "Camera" : `Camera ${known.word}`,
      title: `Camera ${camera.name} (${camera.kind}) ${known.word}`,
      detail: camera.message ? `${camera.message} ${numbers}` : numbers,
    };
  });
  if (!cameras.length) cameras.push({ ...CAMERAS.lost, short: "No camera", title: "No camera", detail: "No camera is set up." });
  const free = status.storage.free_mb;
  const storage = free < FULL_MB ? { state: "bad", icon: "cross" } : free < LOW_MB ? { state: "fair", icon: "warning" } : { state: "good", icon: "accept" };
  const clock = CLOCKS[status.clock.source] ?? CLOCKS.none;
  return [
    ...cameras,
    { ...storage, short: "Storage low", title: `Storage: ${space(free)} free`, detail: "" },
    { ...clock, short: clock.word, title: clock.word, detail: "" },
    ...(status.prompts ?? []).filter((prompt) => !TOLD.includes(prompt.code)).map(concern),
  ];
}

export function showHealth(status, link) {
  const items = status ? healthItems(status) : [];
  const worst = items.reduce((bad, item) => (RANK[item.state] > RANK[bad.state] ? item : bad), { state: "good", icon: "accept", short: "Box OK" });
  const shown = link === "lost" ? { state: "bad", icon: "unlinked", short: "No link" } : worst;
  setData(byId("health-word"), "state", shown.state);
  setIcon(byId("health-word"), shown.icon);
  setText(byId("health-text"), shown.short);
  if (!byId("health").open || !status) return;
  const rows = items.map((item) => {
    const words = html("div", {}, [html("strong", {}, item.title)]);
    if (item.detail) words.append(html("span", { class: "small" }, item.detail));
    return html("li", { "data-state": item.state }, [icon(item.icon), words]);
  });
  const more = html("p", {}, [html("a", { href: "/health" }, "Everything about the box"), " · ", html("a", { href: "/alone" }, "While nobody looked")]);
  byId("health-body").replaceChildren(html("ul", {}, rows), more, html("p", { class: "small" }, [`borescout ${status.version} · `, html("a", { href: "/pair" }, "Paired devices and control")]));
}
