// The calibration page: somebody holds a board, the page shows what is covered, what is missing, and what came out.

import { ask } from "./api.js";
import { byId, data, html, setData, setText, showFailure, toast, wake } from "./dom.js";
import { wantNumber } from "./numbers.js";
import { PicturePoller } from "./picture.js";
import { startShell } from "./shell.js";
import { percent } from "./words.js";

const PATH = "/anomaly/calibration";
const ASK_MS = 500;
const SIDES = ["left", "right"];

let now = data("calibration-data");

// --- what is shown --------------------------------------------------------------------------------------------------------------

const sentence = (text) => text.charAt(0).toUpperCase() + text.slice(1);

function prompt() {
  if (now.state === "gathering") {
    if (!now.seen) return ["waiting", "Waiting for the cameras …", "They are being started."];
    if (now.seen === "kept") return ["good", "Taken.", now.next ? `${sentence(now.next)}.` : "That is enough."];
    return ["fair", `${sentence(now.seen)}.`, now.next ? `${sentence(now.next)}.` : ""];
  }
  if (now.state === "computing") return ["waiting", "Calculating.", "The board may be put away."];
  if (now.state === "failed") return ["poor", "Refused.", now.message];
  if (now.state === "done") return ["good", "Calibrated.", "Look at what came out, then use it."];
  if (now.state === "saved") return ["good", "In use.", "The cameras are rectified with it from now on."];
  return ["waiting", "Ready.", "Press Start with the board in hand."];
}

function showCovered() {
  for (const side of SIDES) {
    const cells = (now.covered?.[side] ?? []).flat();
    byId(`cells-${side}`).replaceChildren(...cells.map((seen) => html("i", { class: seen ? "covered" : "" })));
    const share = cells.filter(Boolean).length / (cells.length || 1);
    setText(byId(`covered-${side}`), cells.length ? `${percent(share)} covered, ${percent(now.covered_wanted)} needed` : "nothing covered yet");
  }
  setText(byId("views"), `${now.views} of ${now.views_wanted}`);
  for (const place of document.querySelectorAll("[data-tilt]")) setText(place, `${Math.min(now.tilts[place.dataset.tilt], now.tilts_wanted)} of ${now.tilts_wanted}`);
}

function showFound() {
  const found = now.state === "done" ? now.found : null;
  byId("found").hidden = !found;
  if (!found) return;
  const left = found.left_out.length ? `, ${found.left_out.length} left out` : "";
  setText(byId("found-views"), `${found.views}${left}`);
  setText(byId("found-corners"), `${found.reprojection_px} px off`);
  setText(byId("found-rows"), `${found.epipolar_px} px apart`);
  setText(byId("found-offset"), `± ${found.offset_std_px} px`);
  setText(byId("found-scale"), `± ${found.scale_percent} %`);
  setText(byId("found-baseline"), `${found.baseline_mm} mm`);
}

function show() {
  const busy = now.state === "gathering" || now.state === "computing";
  const [level, reason, remedy] = prompt();
  setData(byId("calibrate"), "state", now.state);
  setData(byId("prompt"), "level", level);
  setText(byId("prompt-reason"), reason);
  setText(byId("prompt-remedy"), remedy);
  byId("begin").hidden = busy;
  byId("finish").hidden = now.state !== "gathering";
  byId("cancel").hidden = !busy && now.state !== "done";
  setText(byId("cancel"), busy ? "Cancel" : "Throw it away");
  if (now.calibrated) setText(byId("in-use"), `In use: ${now.calibrated.board}, ${now.calibrated.views} views, disparities ± ${now.calibrated.offset_std_px} px.`);
  for (const field of byId("board-form").elements) field.disabled = busy;
  showCovered();
  showFound();
}

// --- asking ---------------------------------------------------------------------------------------------------------------------

async function askAgain() {
  if (document.hidden) return;
  try {
    now = await ask(PATH, { timeoutMs: 3000 });
    show();
  } catch {
    // the link's own watch tells
  }
}

async function act(path, body) {
  showFailure(byId("failure"), "");
  try {
    await ask(path, { method: "POST", body });
    if (path.endsWith("/save")) toast("The calibration is in use.");
  } catch (error) {
    showFailure(byId("failure"), error.message);
  }
  await askAgain();
}

const board = () => ({
  kind: byId("kind").value,
  columns: wantNumber(byId("columns").value, "Squares across"),
  rows: wantNumber(byId("rows").value, "Squares down"),
  square_mm: wantNumber(byId("square").value, "Square"),
});

function begin() {
  let wanted;
  try {
    wanted = board();
  } catch (error) {
    return showFailure(byId("failure"), error.message);
  }
  return act(PATH, wanted);
}

// --- wiring ---------------------------------------------------------------------------------------------------------------------

startShell();
byId("begin").addEventListener("click", begin);
for (const what of ["finish", "cancel", "save"]) byId(what).addEventListener("click", () => act(`${PATH}/${what}`));
byId("board-form").addEventListener("submit", (event) => event.preventDefault());
byId("board-form").addEventListener("change", () => {
  byId("board-pdf").href = `/api/v1${PATH}/board.pdf?${new URLSearchParams({ kind: byId("kind").value, columns: byId("columns").value, rows: byId("rows").value, square_mm: byId("square").value.replace(",", ".") })}`;
});
for (const side of SIDES) {
  new PicturePoller(byId(side), "stereo", {
    wanted: () => now.state === "gathering",
    onPicture: () => {},
    onNone: () => {},
    address: () => `/api/v1${PATH}/${side}.jpg?`,
  }).run();
}
setInterval(askAgain, ASK_MS);
show();
wake();
