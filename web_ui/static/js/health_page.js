// The page of the box's health: readings every two seconds, each with its state in words, an icon and a colour.

import { ask } from "./api.js";
import { byId, data, html, icon, wake } from "./dom.js";
import { showLamp, startLamp } from "./lamp.js";
import { startShell } from "./shell.js";
import { CAMERAS, CLOCKS, age } from "./words.js";

const PERIOD_MS = 2000;
const ROLES = { camera: "Depth camera", grabber: "CCTV", encoder: "Tether encoder", stereo: "Stereo camera" };
const STATES = { ...CAMERAS, resting: { word: "resting", state: "good", icon: "accept" } };
const HOTSPOTS = { up: "working", silent: "silent, being restarted", off: "off, being started", unknown: "not watched" };

const space = (megabytes) => (megabytes >= 1000 ? `${(megabytes / 1000).toFixed(1)} GB` : `${megabytes} MB`);
const known = (value, text) => (value === null || value === undefined ? "not told" : text(value));

function concern(prompt) {
  return html("li", { "data-state": "fair" }, [
    icon("warning"),
    html("div", {}, [html("strong", {}, prompt.reason), html("span", {}, prompt.remedy)]),
  ]);
}

function sensor(one) {
  const state = STATES[one.state] ?? { word: one.state, state: "fair", icon: "warning" };
  const numbers = `last good sample ${age(one.age_s)} ago, ${one.fps.toFixed(1)} a second, ${one.drops} dropped, ${one.bad} bad, ${one.reconnects} reconnects`;
  return html("li", { "data-state": state.state }, [
    icon(state.icon),
    html("div", {}, [html("strong", {}, `${ROLES[one.role] ?? one.role} ${state.word}`), html("span", {}, one.name), html("span", { class: "small" }, numbers)]),
  ]);
}

function power(found) {
  if (found.under_voltage) return "too little voltage now";
  if (found.throttled || found.frequency_capped || found.soft_temperature_limit) return "slowed down now";
  if (found.under_voltage_before) return "too little voltage since it was switched on";
  return "good";
}

export function facts(health) {
  const { machine } = health;
  const rows = [
    ["Free space", `${space(health.disk_free_mb)} of ${space(health.disk_total_mb)}`],
    ["Temperature", known(machine.temperature_c, (value) => `${value.toFixed(0)} °C`)],
    ["Power", known(machine.power, power)],
    ["Free memory", known(machine.memory_free_mb, space)],
    ["Clock", (CLOCKS[health.clock] ?? CLOCKS.none).word],
    ["Hotspot", HOTSPOTS[machine.hotspot] + (health.hotspot_restored ? `, restarted ${health.hotspot_restored} times` : "")],
    ["Phones on it", known(machine.wifi_clients, String)],
  ];
  for (const camera of machine.usb) rows.push([camera.name, `USB ${camera.mbps >= 5000 ? "3" : "2"}, ${camera.mbps} Mbit/s`]);
  return rows;
}

function show(health) {
  const fine = html("li", { "data-state": "good" }, [icon("accept"), html("div", {}, [html("strong", {}, "Nothing. The box is well.")])]);
  const concerns = health.prompts.map(concern);
  const text = health.prompts.map((prompt) => prompt.code).join();
  if (byId("concerns").dataset.shown !== `=${text}`) {
    byId("concerns").dataset.shown = `=${text}`;
    byId("concerns").replaceChildren(...(concerns.length ? concerns : [fine]));
  }
  byId("sensors").replaceChildren(...health.sensors.map(sensor));
  byId("machine").replaceChildren(
    ...facts(health).map(([name, value]) => html("div", {}, [html("dt", {}, name), html("dd", {}, value)])),
  );
}

const feed = startShell();
feed.on("status", (status) => showLamp(status.lamp));
show(data("health-data"));
startLamp();
wake();

async function poll() {
  if (!document.hidden) {
    try {
      show(await ask("/health", { timeoutMs: 4000 }));
    } catch {
      // The banner of the shell says that the box is out of reach.
    }
  }
  setTimeout(poll, PERIOD_MS);
}
poll();
