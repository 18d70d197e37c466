// The strip that says who controls the box, with the buttons to ask for the control, to hand it over and to keep it.

import { ask } from "./api.js";
import { announce, byId, setText, showFailure } from "./dom.js";

const me = document.body.dataset.session;
let ends = 0; // when the open request is granted by itself
let said = "";

// What to show of a state of the box: {text(secondsLeft), buttons}, or null where there is nothing to say.
export function controlWords(state, own) {
  const { controller, request } = state;
  if (!controller) return null;
  if (controller.id === own) {
    if (!request) return null;
    return { text: (left) => `${request.name} asks for the control. Without an answer it goes over in ${left} s.`, buttons: ["grant", "refuse"] };
  }
  if (!request) return { text: () => `${controller.name} controls the box; this device watches.`, buttons: ["ask"] };
  if (request.id === own) return { text: (left) => `${controller.name} was asked for the control; without an answer it comes here in ${left} s.`, buttons: ["release"] };
  return { text: () => `${controller.name} controls the box and was asked by ${request.name}; this device watches.`, buttons: [] };
}

let words = null;

function tick() {
  if (words) setText(byId("control-text"), words.text(Math.max(0, Math.ceil((ends - performance.now()) / 1000))));
}

export function showControl(state) {
  words = controlWords(state, me);
  ends = performance.now() + (state.request?.left_s ?? 0) * 1000;
  byId("control").hidden = !words;
  for (const button of document.querySelectorAll("#control button")) button.hidden = !words?.buttons.includes(button.dataset.does);
  tick();
  // Said once, not at every second of the countdown.
  const key = words ? `${state.controller.id} ${state.request?.id}` : "";
  if (key !== said && (words || said)) announce(words ? byId("control-text").textContent : "This device controls the box.");
  said = key;
}

export function startControl(feed) {
  feed.on("control", showControl);
  setInterval(tick, 500);
  for (const button of document.querySelectorAll("#control button")) {
    button.addEventListener("click", async () => {
      try {
        showControl(await ask(`/control/${button.dataset.does}`, { method: "POST" }));
        showFailure(byId("control-failed"), null);
      } catch (error) {
        showFailure(byId("control-failed"), error.message);
      }
    });
  }
}
