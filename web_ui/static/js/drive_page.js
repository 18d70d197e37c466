// The Drive page: choose the pipe, drive, see what lies where, mark, end.

import { ask } from "./api.js";
import { Counter } from "./counter.js";
import { announce, byId, data, html, setData, setIcon, setText, showFailure, toast, wake } from "./dom.js";
import { HALF_HOURS, clockText, metresText } from "./drive_words.js";
import { readNumber } from "./numbers.js";
import { LandmarkViews } from "./landmark_views.js";
import { PicturePoller, viewState } from "./picture.js";
import { PipeChooser } from "./pipes.js";
import { showLamp, startLamp } from "./lamp.js";
import { startShell } from "./shell.js";
import { CAMERAS, age } from "./words.js";

const FEEDS = { ...CAMERAS, resting: { word: "resting", state: "good", icon: "dot" } };
const MAP_EVERY_MS = 5000;
const SILENT_S = 1;
const READY = { reason: "Ready.", remedy: "Put the crawler at the start node, choose pipe and direction, press Start." };
const PAUSED = { reason: "Paused: nothing is mapped.", remedy: "Press Resume before the crawler drives on." };
const FINISHING = { reason: "Finishing the map.", remedy: "The page goes to the map when it is stored." };
const DRIVING = { reason: "Mapping.", remedy: "Drive on. Press Mark at anything that the box does not see." };
const NOTHING = { reason: "Mapping, nothing found yet.", remedy: "Landmarks show here and on the map as the crawler comes to them." };
const SETUP = { reason: "This box cannot drive.", remedy: "Set up its crawler first." };

const now = () => performance.now() / 1000;
const { drive: first } = data("drive-data");
const seen = { drive: first, at: now(), pictureAt: null, none: false };
const feed = startShell({ live: "drive" });
const chooser = new PipeChooser(() => {});
const counter = new Counter();
const views = new LandmarkViews({ surveyId: first.survey_id, live: true });
let ended = null; // the survey that is being finished: the page goes to its map
let cancelled = null;

const driving = () => seen.drive.state !== "idle";

// --- what the crawler sees -------------------------------------------------------------------------------------------------------

const grown = (source) => (source?.age_s === null || source?.age_s === undefined ? null : source.age_s + now() - seen.at);

function showView() {
  const { grabber } = seen.drive;
  const view = byId("view-cctv");
  const shown = !grabber
    ? { state: "waiting", text: "No CCTV grabber." }
    : viewState({ link: feed.link, camera: grabber.state, ageS: grown(grabber), pictureAgeS: seen.pictureAt === null ? null : now() - seen.pictureAt, age });
  setData(view, "state", shown.state);
  if (shown.text) setText(byId("cctv-veil"), shown.text.replace(/camera/g, "CCTV").replace(/Camera/g, "CCTV"));
  showFeed("grabber", grabber, shown.state === "live" || shown.state === "waiting", "CCTV");
  showFeed("encoder", seen.drive.encoder, true, "Counter");
}

function showFeed(name, source, fine, title) {
  const chip = byId(`${name}-chip`);
  const known = FEEDS[source?.state] ?? FEEDS.starting;
  const lost = feed.link === "lost";
  const state = !source ? "unknown" : lost ? "bad" : !fine && known.state === "good" ? "fair" : known.state;
  setData(chip, "state", state);
  setIcon(chip, !source ? "dot" : state === "good" ? "accept" : state === "bad" ? "cross" : "warning");
  if (!source) setText(byId(`${name}-text`), name === "encoder" ? "No counter on the tether" : "No CCTV grabber");
  else if (lost) setText(byId(`${name}-text`), `${title}: no link`);
  else setText(byId(`${name}-text`), source.state === "resting" || grown(source) === null ? `${title} ${known.word}` : `${title} ${known.word}, ${age(grown(source))} ago`);
}

let spokenState = "";
function speakFeeds() {
  const lost = [["CCTV", seen.drive.grabber], ["Counter", seen.drive.encoder]].filter(([, source]) => source?.state === "lost").map(([title]) => `${title} lost.`).join(" ");
  if (lost !== spokenState && (lost || spokenState)) announce(lost || "CCTV and counter are back.");
  spokenState = lost;
}

function showPrompt(level, { reason, remedy }) {
  setData(byId("prompt"), "level", level);
  setText(byId("prompt-reason"), reason);
  setText(byId("prompt-remedy"), remedy);
}

function prompt() {
  const { drive } = seen;
  if (feed.link === "lost") return ["lost", { reason: "No link to the box.", remedy: "Stop the crawler. Check that this device is on the box's Wi-Fi." }];
  if (!drive.available) return ["waiting", SETUP];
  if (drive.state === "finishing") return ["good", FINISHING];
  if (drive.prompts?.length) return ["fair", drive.prompts[0]];
  if (drive.grabber?.state === "lost") return ["lost", { reason: "The CCTV picture is lost.", remedy: drive.grabber.message || "Check the camera and its cable." }];
  if (drive.encoder?.state === "lost") return ["lost", { reason: "The counter is silent.", remedy: drive.encoder.message || "Check its cable." }];
  if (drive.state === "paused") return ["fair", PAUSED];
  if (drive.state === "driving") return ["good", views.landmarks.size ? DRIVING : NOTHING];
  return ["waiting", READY];
}

function show() {
  const { drive } = seen;
  const state = drive.state;
  showView();
  showPrompt(...prompt());
  setData(byId("drive"), "state", state);
  setData(byId("drive"), "empty", state === "idle" && views.map.empty ? "yes" : "no");
  const idleMetres = drive.encoder?.metres;
  setText(byId("chainage"), metresText(driving() ? drive.chainage_m : (idleMetres ?? null)));
  setText(byId("sigma"), driving() && drive.sigma_m !== null && drive.sigma_m !== undefined ? `± ${(drive.sigma_m * 100).toFixed(drive.sigma_m < 0.0095 ? 1 : 0)} cm` : driving() ? "" : idleMetres === null || idleMetres === undefined ? "" : "before the drive");
  setText(byId("speed"), driving() && drive.speed_mps !== null ? drive.speed_mps.toFixed(2) : "–");
  const found = drive.counts.confirmed + drive.counts.passed;
  setText(byId("counts-line"), driving() ? `${found} found, ${drive.counts.candidate} perhaps` : "");
  byId("setup").hidden = state !== "idle";
  byId("drive-idle").hidden = state !== "idle";
  byId("drive-running").hidden = state !== "driving" && state !== "paused";
  byId("drive-finishing").hidden = state !== "finishing";
  byId("start").disabled = !drive.available || feed.link === "lost";
  for (const id of ["pause", "mark", "end", "cancel"]) byId(id).disabled = feed.link === "lost";
  setIcon(byId("pause"), state === "paused" ? "play" : "pause");
  setText(byId("pause").querySelector("span"), state === "paused" ? "Resume" : "Pause");
  const bar = byId("finish-bar");
  if (drive.progress === null) bar.removeAttribute("value");
  else bar.value = drive.progress;
  setText(byId("finish-share"), drive.progress === null ? "" : `${Math.round(drive.progress * 100)} %`);
  byId("map-follow").hidden = !driving();
  counter.show(drive.encoder, state === "idle");
  speakFeeds();
}

// --- the drive goes on --------------------------------------------------------------------------------------------------------------

function onDrive(drive) {
  const before = seen.drive;
  Object.assign(seen, { drive, at: now() });
  if (drive.survey_id !== null && drive.survey_id !== views.surveyId) {
    views.restart(drive.survey_id);
    views.map.follow(true);
    refreshMap();
  }
  if (drive.state === "finishing") ended = drive.survey_id;
  views.change(drive.landmarks ?? [], drive.gone ?? []);
  for (const fault of drive.faults ?? []) toast(fault.text);
  if (driving()) {
    views.crawler(drive.chainage_m, drive.sigma_m);
    views.moved();
  }
  if (before.state !== drive.state) changed(before, drive);
  show();
}

function changed(before, drive) {
  if (drive.state === "idle") {
    const over = before.survey_id;
    for (const name of ["mark", "end", "cancel"]) byId(`${name}-dialog`).close();
    if (over !== null && over === cancelled) {
      announce("The drive was cancelled.");
      views.restart(null);
    } else if (over !== null) finished(over, drive.message);
    if (document.activeElement === document.body) byId("start").focus();
  } else announce({ driving: before.state === "paused" ? "Mapping again." : "Mapping.", paused: "Paused.", finishing: "Finishing the map." }[drive.state] ?? "");
}

// The stream may have been away when the drive ended: the box knows what became of it.
async function finished(surveyId, message) {
  try {
    const { state } = await ask(`/surveys/${surveyId}/map`);
    if (ended === surveyId && !message) location.assign(`/surveys/${surveyId}`);
    else {
      const place = byId("failed");
      showFailure(place, `${message || (state === "interrupted" ? "The drive was cut off." : "The drive is over.")} `);
      place.append(html("a", { href: `/surveys/${surveyId}` }, "See its map"));
    }
  } catch (error) {
    if (error.status === 404) {
      showFailure(byId("failed"), message || "The drive was cancelled.");
      views.restart(null);
    } else showFailure(byId("failed"), error.message);
  }
}

// Between drives the box sends no events of this kind.
async function askIfSilent() {
  if (document.hidden || now() - seen.at < SILENT_S) return;
  try {
    const drive = await ask("/drive", { timeoutMs: 3000 });
    if (now() - seen.at >= SILENT_S) onDrive(drive);
  } catch {
    // The banner tells when the box is out of reach.
  }
}

async function refreshMap() {
  const surveyId = seen.drive.survey_id;
  if (surveyId === null || document.hidden) return;
  try {
    const map = await ask(`/surveys/${surveyId}/map`);
    if (seen.drive.survey_id !== surveyId) return;
    // Landmarks come with the events, and newer; from here only those that were there before the page was.
    const landmarks = feed.streaming ? map.landmarks.filter((landmark) => !views.landmarks.has(landmark.id)) : map.landmarks;
    views.load({ ...map, landmarks });
  } catch {
    // Asked again in some seconds; the banner tells when the box is out of reach.
  }
}

// --- what the operator does -----------------------------------------------------------------------------------------------------------

async function act(path, body, failure = byId("failed")) {
  try {
    const answer = await ask(path, { method: "POST", body });
    showFailure(failure, null);
    return answer ?? true;
  } catch (error) {
    showFailure(failure, error.message);
    return null;
  }
}

function typed(id, name, { least = -Infinity } = {}) {
  const value = readNumber(byId(id).value);
  if (value !== null && !(value > least)) {
    byId(id).closest("details")?.setAttribute("open", "");
    byId(id).focus();
    throw new Error(least === 0 ? `${name}: a number above 0, or nothing.` : `${name}: a number, or nothing.`);
  }
  return value;
}

async function start() {
  const body = { direction: byId("direction-up").checked ? "upstream" : "downstream" };
  try {
    const radius = typed("radius", "Inner radius", { least: 0 });
    const place = typed("first-chainage", "Chainage now");
    if (radius !== null) body.radius_m = radius / 1000;
    if (place !== null) body.start_chainage_m = place;
  } catch (error) {
    showFailure(byId("failed"), error.message);
    return;
  }
  if (chooser.chosen) body.pipe_id = chooser.chosen.id;
  byId("start").disabled = true;
  if (await act("/drive", body)) {
    onDrive({ ...(await ask("/drive").catch(() => seen.drive)), landmarks: [] });
    byId("pause").focus({ preventScroll: true });
  } else show();
}

async function pause() {
  const going = seen.drive.state === "driving";
  if (await act(going ? "/drive/pause" : "/drive/resume")) onDrive({ ...seen.drive, state: going ? "paused" : "driving", landmarks: [] });
}

function openMark() {
  const form = byId("mark-form");
  form.reset();
  showFailure(byId("mark-error"), null);
  byId("mark-other-field").hidden = true;
  byId("mark-dialog").showModal();
}

async function mark(event) {
  event.preventDefault();
  const chosen = byId("mark-form").elements.label.value;
  const label = chosen === "other" ? byId("mark-other").value.trim() : chosen;
  if (!label) {
    showFailure(byId("mark-error"), chosen === "other" ? "Say what it is." : "Choose what it is.");
    return;
  }
  const body = { label, note: byId("mark-note").value.trim() };
  if (byId("mark-clock").value) body.clock = Number(byId("mark-clock").value);
  const landmark = await act("/drive/mark", body, byId("mark-error"));
  if (!landmark) return;
  byId("mark-dialog").close();
  views.change([landmark]);
  announce(`Marked: ${label}.`);
  toast(`Marked: ${label}, ${metresText(landmark.chainage_m)} m.`);
}

async function end(event) {
  event.preventDefault();
  const body = {};
  try {
    const length = typed("end-length", "Length", { least: 0 });
    if (length !== null) body.length_m = length;
  } catch (error) {
    showFailure(byId("end-error"), error.message);
    return;
  }
  const answer = await act("/drive/end", body, byId("end-error"));
  if (!answer) return;
  ended = answer.survey_id;
  byId("end-dialog").close();
}

async function cancel() {
  cancelled = seen.drive.survey_id; // before the answer: the event that it is over may come first
  if (!(await act("/drive/cancel", {}, byId("cancel-error")))) cancelled = null;
  else byId("cancel-dialog").close();
}

function toggleOverlay() {
  const button = byId("overlay-button");
  button.setAttribute("aria-pressed", String(button.getAttribute("aria-pressed") !== "true"));
}

// The class whose heatmap is wanted over the picture, as part of its address.
function heat() {
  const wanted = byId("heatmap").value;
  return wanted ? `heatmap=${encodeURIComponent(wanted)}&` : "";
}

// --- wiring ------------------------------------------------------------------------------------------------------------------------

byId("mark-clock").replaceChildren(html("option", { value: "" }, "not known"), ...HALF_HOURS.map((hour) => html("option", { value: hour }, clockText(hour))));
byId("start").addEventListener("click", start);
byId("pause").addEventListener("click", pause);
byId("mark").addEventListener("click", openMark);
byId("mark-form").addEventListener("submit", mark);
byId("mark-form").addEventListener("change", () => (byId("mark-other-field").hidden = byId("mark-form").elements.label.value !== "other"));
byId("end").addEventListener("click", () => {
  showFailure(byId("end-error"), null);
  byId("end-dialog").showModal();
});
byId("end-form").addEventListener("submit", end);
byId("cancel").addEventListener("click", () => byId("cancel-dialog").showModal());
byId("cancel-confirm").addEventListener("click", cancel);
for (const button of document.querySelectorAll("[data-close]")) button.addEventListener("click", () => button.closest("dialog").close());
byId("overlay-button").addEventListener("click", toggleOverlay);
feed.on("drive", onDrive);
feed.on("link", show);
feed.on("stream", refreshMap); // what was found between the first map and the first event is in neither

if (first.grabber)
  new PicturePoller(byId("cctv"), "drive", {
    address: () => `/api/v1/drive/picture.jpg?overlay=${byId("overlay-button").getAttribute("aria-pressed") === "true" ? 1 : 0}&${heat()}`,
    wanted: () => true,
    onPicture: () => (seen.pictureAt = now()),
    onNone: () => {},
  }).run();
setInterval(show, 250);
setInterval(askIfSilent, 500);
setInterval(refreshMap, MAP_EVERY_MS);
startLamp();
feed.on("status", (status) => showLamp(status.lamp));
wake();
show();
refreshMap();
