// The anomaly page: aim the stereo camera, see what it would see, scan, wait.

import { ask } from "./api.js";
import { byId, setData, setIcon, setText, svg, wake } from "./dom.js";
import { wantNumber } from "./numbers.js";
import { PicturePoller, viewState } from "./picture.js";
import { PipeChooser } from "./pipes.js";
import { Running } from "./running.js";
import { startShell } from "./shell.js";
import { CAMERAS, age, percent } from "./words.js";

const READY = { reason: "Both cameras see the wall.", remedy: "Hold the box still and press Scan." };
const WAITING = { reason: "Waiting for the stereo camera …", remedy: "It is started when somebody looks; this takes a few seconds." };
const ASK_MS = 2500;

const available = byId("anomaly").dataset.available === "yes";
const now = () => performance.now() / 1000;
const seen = { state: null, at: 0, pictureAt: null };

const feed = startShell({ live: "anomaly" });
const chooser = new PipeChooser(() => {});
const running = new Running({
  kind: "anomaly",
  path: "/anomaly",
  noun: "scan",
  doing: "Scanning",
  silenceMs: 4000,
  lock: (on) => (chooser.disabled = on),
  describe: (survey) => {
    const computing = survey.state === "computing";
    const wanted = survey.frames_wanted || 1;
    return {
      word: computing ? "Computing" : "Hold still",
      count: `${Math.min(survey.frames_done + (computing ? 1 : 0), wanted)} of ${wanted} pairs`,
      value: survey.frames_done + (computing ? wanted : 0),
      max: 2 * wanted,
    };
  },
});

// --- what the camera sees -------------------------------------------------------------------------------------------------------

// The pipe as a circle, the camera as a cross in it.
function showTarget(live) {
  const known = live && live.right !== null;
  const place = byId("aim-target");
  const drawing = svg("svg", { viewBox: "-1.15 -1.15 2.3 2.3", "aria-hidden": "true" }, [
    svg("circle", { r: 1, class: "pipe" }),
    svg("circle", { r: 0.35, class: "middle" }),
  ]);
  if (known) {
    const [x, y] = [live.right, live.down].map((part) => Math.max(-1, Math.min(1, part)));
    drawing.append(svg("path", { d: `M${x - 0.16} ${y}h.32M${x} ${y - 0.16}v.32`, class: "camera" }));
  }
  place.replaceChildren(drawing);
  place.setAttribute("aria-label", known ? `The camera stands ${aside(live)}` : "Where the camera stands in the pipe: not known");
}

function aside(live) {
  if (live.right === null) return "–";
  const off = Math.hypot(live.right, live.down);
  if (off < 0.05) return "in the middle";
  const words = [];
  if (Math.abs(live.down) > 0.03) words.push(live.down > 0 ? "low" : "high");
  if (Math.abs(live.right) > 0.03) words.push(live.right > 0 ? "right" : "left");
  return `${Math.round(100 * off)} % of the radius, ${words.join(" and ")}`;
}

let shown = "";
function showLive() {
  const camera = seen.state?.camera;
  const late = now() - seen.at;
  const live = seen.state?.live && seen.state.live.age_s + late < 8 && feed.link === "up" ? seen.state.live : null;
  const key = JSON.stringify([live?.frame, camera?.state, feed.link, running.on]);
  if (key === shown) return;
  shown = key;
  showTarget(live);
  setText(byId("aim-matched"), percent(live?.matched));
  setText(byId("aim-around"), percent(live?.around));
  setText(byId("aim-aside"), live ? aside(live) : "–");
  setText(byId("aim-radius"), live?.radius_mm ? `${live.radius_mm} mm` : "–");
  byId("start").disabled = !available || feed.link === "lost";
  if (running.on) return showPrompt("good", { reason: "Scanning.", remedy: "Hold the box still until the pairs are taken." });
  if (feed.link === "lost") return showPrompt("lost", { reason: "No link to the box.", remedy: "Stay near the box and check that this device is on its Wi-Fi." });
  if (camera?.state === "lost") return showPrompt("lost", { reason: "The stereo camera is lost.", remedy: camera.message });
  if (live) return showPrompt(live.level, live.prompt ?? READY);
  if (camera?.state === "degraded") return showPrompt("fair", { reason: "The stereo camera is troubled.", remedy: camera.message });
  return showPrompt("waiting", WAITING);
}

function showPrompt(level, { reason, remedy }) {
  setData(byId("prompt"), "level", level);
  setText(byId("prompt-reason"), reason);
  setText(byId("prompt-remedy"), remedy);
}

function showView() {
  const camera = seen.state?.camera;
  const state = camera?.state === "resting" || !camera ? "starting" : camera.state;
  const pictureAgeS = seen.pictureAt === null ? null : now() - seen.pictureAt;
  const ageS = camera && camera.age_s !== null ? camera.age_s + now() - seen.at : null;
  // a pair comes twice a second and its state less often: the picture itself tells whether it is live
  const view = viewState({ link: feed.link, camera: state, ageS: pictureAgeS, pictureAgeS, age });
  setData(byId("view-stereo"), "state", view.state);
  if (view.text) setText(byId("stereo-veil"), available ? view.text : "This box has no stereo camera.");
  const known = CAMERAS[state] ?? CAMERAS.starting;
  const chip = byId("camera-chip");
  setData(chip, "state", known.state);
  setIcon(chip, known.icon);
  setText(byId("camera-text"), camera ? `${known.word}, pair ${age(ageS)} ago` : "no stereo camera");
  showLive();
}

function onState(state) {
  seen.state = state;
  seen.at = now();
  followTether();
  running.heard(state);
  showView();
}

// --- where the camera stands ----------------------------------------------------------------------------------------------------

// Where the camera is the crawler's the field follows the tether until somebody says otherwise; elsewhere when asked to.
let follows = null;
function followTether() {
  const counted = seen.state?.chainage_m ?? null;
  const on = follows ?? seen.state?.on_crawler ?? false;
  byId("chainage-tether").hidden = counted === null || on;
  if (on && !running.on) byId("chainage").value = counted === null ? "" : counted.toFixed(2);
}

function setFollows(on) {
  follows = on;
  followTether();
}

// --- scanning -------------------------------------------------------------------------------------------------------------------

const asked = () => ({
  pipe_id: chooser.chosen?.id ?? null,
  chainage_m: wantNumber(byId("chainage").value.replace(/\s*m\s*$/i, ""), "Camera stands at"),
});

// --- wiring ---------------------------------------------------------------------------------------------------------------------

byId("start").addEventListener("click", () => running.start(asked, Number(byId("anomaly").dataset.pairs)));
byId("chainage").addEventListener("input", () => setFollows(false));
byId("chainage-tether").addEventListener("click", () => setFollows(true));
feed.on("anomaly", onState);
feed.on("measurement", (event) => running.event(event));
feed.on("prompt", (prompt) => running.prompt(prompt));
feed.on("link", showView);

async function askAgain() {
  if (document.hidden) return;
  try {
    onState(await ask("/anomaly", { timeoutMs: 3000 }));
  } catch {
    // the link's own watch tells
  }
}

if (available) {
  new PicturePoller(byId("stereo"), "stereo", {
    wanted: () => true,
    onPicture: () => (seen.pictureAt = now()),
    onNone: () => {},
    address: () => "/api/v1/anomaly/picture.jpg?",
  }).run();
  setInterval(askAgain, ASK_MS);
  askAgain();
}
setInterval(showView, 500);
showView();
wake();
