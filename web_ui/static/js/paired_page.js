// Who is paired, and sending somebody away.

import { ask } from "./api.js";
import { showControl } from "./control.js";
import { byId, html, showFailure, wake } from "./dom.js";
import { startShell } from "./shell.js";
import { age } from "./words.js";

const me = document.body.dataset.session;
const feed = startShell();

async function attempt(what) {
  try {
    await what();
    showFailure(byId("pair-failed"), null);
    await show();
  } catch (error) {
    showFailure(byId("pair-failed"), error.message);
  }
}

async function show() {
  const devices = await ask("/sessions");
  const mine = devices.find((device) => device.id === me);
  byId("release").hidden = !mine?.controls;
  const rows = devices.map((device) => {
    const state = [device.controls ? "controls the box" : "watches", device.id === me ? "this device" : `heard of ${age(device.silent_s)} ago`];
    const words = html("div", {}, [html("strong", {}, device.name), html("span", { class: "small" }, state.join(", "))]);
    const row = html("li", {}, words);
    if (device.id !== me && mine?.controls) {
      const button = html("button", { type: "button", class: "button quiet" }, "Send away");
      button.setAttribute("aria-label", `Send ${device.name} away`);
      button.addEventListener("click", () => attempt(() => ask(`/sessions/${device.id}`, { method: "DELETE" })));
      row.append(button);
    }
    return row;
  });
  byId("paired").replaceChildren(...rows);
}

byId("release").addEventListener("click", () => attempt(async () => showControl(await ask("/control/release", { method: "POST" }))));
byId("leave").addEventListener("click", () =>
  attempt(async () => {
    feed.stop();
    await ask("/session", { method: "DELETE" });
    location.assign("/pair");
  }),
);
feed.on("control", () => show().catch(() => {})); // with every poll; a lost link is told by its banner
wake();
attempt(show);
