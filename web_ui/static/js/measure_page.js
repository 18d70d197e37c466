// The measuring page: aim, see, press, wait.

import { announce, byId, setData, setIcon, setText, wake } from "./dom.js";
import { gauge } from "./gauge.js";
import { drawOverlay } from "./overlay.js";
import { PicturePoller, viewState } from "./picture.js";
import { PipeChooser } from "./pipes.js";
import { Running } from "./running.js";
import { startShell } from "./shell.js";
import { CAMERAS, LEVELS, age, millimetres } from "./words.js";

const READY = { reason: "The circle lies on the wall.", remedy: "Hold the box still and press Measure." };
const WAITING = { reason: "Waiting for the box …", remedy: "The first values come within seconds." };
const MEASURING = { reason: "Measuring.", remedy: "Hold the box still until all frames are in." };

const second = byId("second");
const wide = window.matchMedia("(min-width: 60rem)");
const views = document.querySelector(".views");
const now = () => performance.now() / 1000;
const seen = { status: null, statusAt: 0, live: null, liveAt: 0, depthAt: null, colorAt: null, noColor: false };

const feed = startShell({ live: "live" });
const chooser = new PipeChooser(showReference);
const running = new Running({
  kind: "diameter",
  path: "/measure",
  noun: "measurement",
  doing: "Measuring",
  silenceMs: 2500,
  lock: (on) => {
    chooser.disabled = on || Boolean(second);
    byId("position").disabled = on;
  },
  describe: (survey) => {
    const computing = survey.state === "computing";
    return {
      word: computing ? "Computing …" : "Hold still",
      count: computing ? "" : `${survey.frames_done} of ${survey.frames_wanted} frames`,
      value: computing ? null : survey.frames_done,
      max: survey.frames_wanted || 1,
    };
  },
});

function showReference(pipe) {
  setText(byId("reference"), pipe?.reference_dn ? `map: DN ${pipe.reference_dn}` : "");
}

// --- what the cameras see -------------------------------------------------------------------------------------------------------

function bestCamera() {
  const cameras = seen.status?.cameras ?? [];
  return cameras.find((camera) => camera.name === seen.live?.camera) ?? cameras.find((camera) => camera.state === "up") ?? cameras[0] ?? null;
}

function frameAge() {
  const camera = bestCamera();
  const ages = [];
  if (camera && camera.age_s !== null) ages.push(camera.age_s + now() - seen.statusAt);
  if (seen.live) ages.push(seen.live.age_s + now() - seen.liveAt);
  return ages.length ? Math.min(...ages) : null;
}

function showView(view, chip, chipText, veil, pictureAt, none) {
  const camera = bestCamera();
  const ageS = frameAge();
  const shown = none
    ? { state: "waiting", text: "This camera gives no colour picture now." }
    : viewState({ link: feed.link, camera: camera?.state ?? "starting", ageS, pictureAgeS: pictureAt === null ? null : now() - pictureAt, age });
  setData(view, "state", shown.state);
  if (shown.text) setText(veil, shown.text);
  const known = CAMERAS[camera?.state] ?? CAMERAS.starting;
  const good = shown.state === "live" || none;
  setData(chip, "state", good ? known.state : shown.state === "lost" ? "bad" : "fair");
  setIcon(chip, good ? known.icon : shown.state === "lost" ? "cross" : "warning");
  const word = feed.link === "lost" ? "no link" : shown.state === "live" ? `live, ${age(ageS)}` : `${known.word}, frame ${age(ageS)} ago`;
  setText(chipText, none ? known.word : shown.state === "waiting" ? known.word : word);
  return shown.state;
}

let depthState = "waiting";
function showViews() {
  const state = showView(byId("view-depth"), byId("camera-chip"), byId("camera-text"), byId("depth-veil"), seen.depthAt, false);
  showView(byId("view-color"), byId("color-chip"), byId("color-text"), byId("color-veil"), seen.colorAt, seen.noColor && state === "live");
  if (state !== depthState) {
    if (state === "lost") announce("Camera lost.");
    else if (state === "live" && depthState !== "waiting") announce("The camera is back.");
    depthState = state;
  }
  showLive();
}

function showDepthOrColor(kind) {
  setData(views, "show", kind);
  byId("show-depth").setAttribute("aria-pressed", String(kind === "depth"));
  byId("show-color").setAttribute("aria-pressed", String(kind === "color"));
}

// --- the live estimate ----------------------------------------------------------------------------------------------------------

let gaugeShown = "";
function showGauge(trust, level) {
  const key = `${trust === null ? "" : trust.toFixed(2)} ${level}`;
  if (key === gaugeShown) return;
  gaugeShown = key;
  byId("gauge").replaceChildren(gauge(trust, level));
}

function showPrompt(level, { reason, remedy }) {
  setData(byId("prompt"), "level", level);
  setText(byId("prompt-reason"), reason);
  setText(byId("prompt-remedy"), remedy);
}

function showLive() {
  const fresh = seen.live !== null && feed.link === "up" && frameAge() !== null && frameAge() < 2;
  const live = fresh ? seen.live : null;
  const level = live?.level ?? "none";
  setData(document.querySelector(".readout"), "trusted", level === "good" || level === "fair" ? "yes" : "no");
  setText(byId("diameter"), millimetres(live?.diameter_mm));
  setText(byId("interval"), live?.interval_mm ? `${millimetres(live.interval_mm[0])} to ${millimetres(live.interval_mm[1])} mm (95 %)` : "no estimate");
  showGauge(live ? live.trust : null, level);
  setData(byId("level"), "level", level);
  setIcon(byId("level"), live ? LEVELS[level].icon : "dot");
  setText(byId("level-text"), live ? LEVELS[level].word : "Unknown");
  drawOverlay(byId("overlay"), live?.circle, level);
  const camera = bestCamera();
  byId("start").disabled = feed.link === "lost" || camera?.state === "lost";
  if (live && running.on && level !== "none") showPrompt("good", MEASURING);
  else if (live) showPrompt(level, live.prompt ?? (level === "none" ? WAITING : READY));
  else if (feed.link === "lost") showPrompt("lost", { reason: "No link to the box.", remedy: "Stay near the box and check that this device is on its Wi-Fi." });
  else if (camera?.state === "lost") showPrompt("lost", { reason: "The camera stopped sending pictures.", remedy: camera.message || "Wait for it to come back, or check its cable." });
  else showPrompt("waiting", WAITING);
}

// --- measuring ------------------------------------------------------------------------------------------------------------------

function onStatus(status) {
  seen.status = status;
  seen.statusAt = now();
  running.heard(status.survey);
}

function asked() {
  const body = { position: byId("position").value };
  if (second) {
    body.survey_id = Number(second.dataset.survey);
    if (second.dataset.pipe) body.pipe_id = Number(second.dataset.pipe);
  } else if (chooser.chosen) body.pipe_id = chooser.chosen.id;
  return body;
}

// --- wiring ---------------------------------------------------------------------------------------------------------------------

byId("start").addEventListener("click", () => running.start(asked, 50));
byId("show-depth").addEventListener("click", () => showDepthOrColor("depth"));
byId("show-color").addEventListener("click", () => showDepthOrColor("color"));
feed.on("status", onStatus);
feed.on("measurement", (event) => running.event(event));
feed.on("prompt", (prompt) => running.prompt(prompt));
feed.on("link", showViews);
feed.on("live", (live) => {
  seen.live = live;
  seen.liveAt = now();
  showLive();
});
showDepthOrColor("depth");

new PicturePoller(byId("depth"), "depth", {
  wanted: () => wide.matches || views.dataset.show === "depth",
  onPicture: () => (seen.depthAt = now()),
  onNone: () => {},
}).run();
new PicturePoller(byId("color"), "color", {
  wanted: () => wide.matches || views.dataset.show === "color",
  onPicture: () => Object.assign(seen, { colorAt: now(), noColor: false }),
  onNone: () => (seen.noColor = true),
}).run();
setInterval(showViews, 250);
showViews();
wake();
