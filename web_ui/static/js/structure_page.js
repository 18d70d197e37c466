// The Structure page: choose the chamber, go around it, watch the map grow, end.

import { ask } from "./api.js";
import { announce, byId, data, html, icon, setData, setText, showFailure, toast, wake } from "./dom.js";
import { startShell } from "./shell.js";
import { StructureViews } from "./structure_views.js";
import { CAMERAS } from "./words.js";

const STATES = { ...CAMERAS, resting: { word: "resting", state: "good", icon: "dot" } };
const ROLES = { scanner: "Scanner", dvl: "DVL", pressure: "Pressure", ahrs: "AHRS" };
const READY = { reason: "Ready.", remedy: "Hold the scanner so that pipes are in view, choose the chamber, press Start." };
const WAITING = { reason: "Waiting for the first scan.", remedy: "Hold still until it has come." };
const SCANNING = { reason: "Mapping.", remedy: "Go slowly around the whole structure, 2 to 3.5 m off, until nothing is unsure." };
const FINISHING = { reason: "Keeping the map.", remedy: "The page goes to it when it is stored." };
const SETUP = { reason: "This box cannot map chambers.", remedy: "Set up its scanner first." };

let state = data("structure-data");
const feed = startShell({ live: "structure" });
const views = new StructureViews();
let shown = { survey: null, scans: -1 };
let fetching = false;
let ended = null; // the survey that is being finished: the page goes to its map

const running = () => state.state !== "idle";

function prompt() {
  if (feed.link === "lost") return ["lost", { reason: "No link to the box.", remedy: "Hold still. Check that this device is on the box's Wi-Fi." }];
  if (!state.available) return ["waiting", SETUP];
  if (state.state === "finishing") return ["good", FINISHING];
  if (state.prompts.length) return [state.prompts[0].code === "map_contradicted" ? "lost" : "fair", state.prompts[0]];
  if (state.state === "waiting") return ["waiting", WAITING];
  if (state.state === "scanning") return ["good", SCANNING];
  return ["good", READY];
}

function showSensors() {
  byId("sensors").replaceChildren(
    ...state.sensors.map((sensor) => {
      const known = STATES[sensor.state] ?? STATES.starting;
      return html("li", { "data-state": known.state }, [icon(known.icon), `${ROLES[sensor.role] ?? sensor.role} ${known.word}`]);
    }),
  );
}

function whereLine() {
  if (!state.position) return running() ? `${Math.round(state.seconds)} s` : "";
  const [north, east, down] = state.position.map((value) => value.toFixed(2));
  const sigma = state.sigma_m === null ? "" : ` ± ${(100 * state.sigma_m).toFixed(1)} cm`;
  const late = state.late + state.dropped;
  return `North ${north} m, east ${east} m, depth ${down} m${sigma}, ${Math.round(state.seconds)} s${late ? `, ${late} scans left out` : ""}`;
}

function show() {
  const [level, words] = prompt();
  setData(byId("prompt"), "level", level);
  setText(byId("prompt-reason"), words.reason);
  setText(byId("prompt-remedy"), words.remedy);
  setData(byId("chamber"), "state", state.state);
  for (const [id, value] of [["scans", state.scans], ["pipes", state.pipes], ["objects", state.objects], ["unsure-count", state.unsure]]) setText(byId(id), String(value));
  setText(byId("where-line"), whereLine());
  showSensors();
  byId("setup").hidden = byId("chamber-idle").hidden = running();
  byId("chamber-running").hidden = !running();
  const newest = document.getElementById("newest");
  if (newest) newest.hidden = running();
  byId("start").disabled = !state.available || running();
  byId("end").disabled = byId("cancel").disabled = !running() || state.state === "finishing";
  void showMap();
}

async function showMap() {
  const { survey_id: survey, scans } = state;
  if (survey === null || fetching || byId("cancel-dialog").open || (shown.survey === survey && shown.scans === scans) || scans === 0) return;
  fetching = true;
  try {
    const map = await ask(`/surveys/${survey}/structure`);
    setData(byId("chamber"), "empty", "no");
    views.show(map);
    shown = { survey, scans };
  } catch {
    // the next state asks again; a lost link has its own banner
  } finally {
    fetching = false;
  }
}

function take(value) {
  const message = value.message;
  state = value;
  show();
  if (value.ended) {
    if (message) {
      toast(message);
      announce(message);
    }
    if (value.stored && (ended === value.ended || value.stored === "saved")) location.assign(`/surveys/${value.ended}`);
    else setData(byId("chamber"), "empty", "yes");
  }
}

async function act(button, action) {
  button.disabled = true;
  showFailure(byId("failed"), "");
  try {
    await action();
  } catch (error) {
    showFailure(byId("failed"), error.message);
    button.disabled = false;
  }
}

async function start() {
  let node = byId("node").value ? Number(byId("node").value) : null;
  const name = byId("node-name").value.trim();
  if (name) {
    const made = await ask("/nodes", { method: "POST", body: { name } });
    node = made.id;
    byId("node").append(html("option", { value: node, selected: "" }, made.name));
    byId("node-name").value = "";
  }
  const begun = await ask("/structure", { method: "POST", body: { node_id: node } });
  state = { ...state, state: "waiting", survey_id: begun.survey_id, scans: 0, prompts: [] };
  show();
}

async function cancel() {
  byId("cancel-confirm").disabled = true;
  try {
    await ask("/structure/cancel", { method: "POST" });
    byId("cancel-dialog").close();
  } catch (error) {
    showFailure(byId("cancel-error"), error.message);
  }
  byId("cancel-confirm").disabled = false;
}

feed.on("structure", (value) => value && take(value));
feed.on("link", show);
byId("start").addEventListener("click", (event) => act(event.currentTarget, start));
byId("end").addEventListener("click", (event) =>
  act(event.currentTarget, async () => {
    ended = (await ask("/structure/end", { method: "POST" })).survey_id;
  }),
);
byId("cancel").addEventListener("click", () => byId("cancel-dialog").showModal());
byId("cancel-confirm").addEventListener("click", cancel);
for (const button of document.querySelectorAll("[data-close]")) button.addEventListener("click", () => button.closest("dialog").close());
show();
wake();
