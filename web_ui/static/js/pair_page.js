// Pairing: six digits; what was wrong, and how long to wait, in words. Stands in place of the page that was asked for.

import { ask, BoxError } from "./api.js";
import { byId, showFailure, wake } from "./dom.js";

const pin = byId("pin");
const button = byId("pair");
const failed = byId("pair-failed");

// Not reload(): a page reached by a foreign link is shown without the session's cookie, and so would be its reload.
const enter = () => location.replace(location.pathname === "/pair" ? "/" : location.href);

let countdown = null;

function waitFor(seconds, sentence) {
  clearInterval(countdown);
  const end = performance.now() + seconds * 1000;
  const tick = () => {
    const left = Math.ceil((end - performance.now()) / 1000);
    button.disabled = left > 0;
    button.textContent = left > 0 ? `Pair (wait ${left} s)` : "Pair";
    if (left <= 0) {
      clearInterval(countdown);
      showFailure(failed, sentence ? `${sentence} You may try again now.` : null);
    }
  };
  countdown = setInterval(tick, 250);
  tick();
}

async function pair() {
  button.disabled = true;
  showFailure(failed, null);
  try {
    await ask("/session", { method: "POST", body: { pin: pin.value } });
    enter();
  } catch (error) {
    button.disabled = false;
    pin.select();
    if (!(error instanceof BoxError)) throw error;
    showFailure(failed, error.message);
    if (error.waitS > 0) waitFor(error.waitS, error.message.split(/[.:] /)[0] + ".");
  }
}

byId("pair-form").addEventListener("submit", (event) => {
  event.preventDefault();
  if (button.disabled) return;
  if (/^[0-9]{6}$/.test(pin.value)) pair();
  else showFailure(failed, "The PIN has six digits.");
});
pin.addEventListener("input", () => {
  const digits = pin.value.replace(/[^0-9]/g, "").slice(0, 6);
  if (digits !== pin.value) pin.value = digits;
  if (digits.length === 6 && !button.disabled) pair();
});

wake();
ask("/session").then((session) => session.paired && enter(), () => {});
