// The lamp: a slider, and whether the pictures say how bright it is.

import { ask } from "./api.js";
import { byId, setText, showFailure } from "./dom.js";

let held = false; // a finger is on the slider: what the box says of it waits

function words(lamp) {
  if (lamp.message) return lamp.message;
  if (lamp.resting) return "Out, since nothing moves; it comes back when the crawler moves or somebody looks at the picture.";
  return lamp.automatic ? "Follows the exposure of the picture." : "Stays as it is set.";
}

export function showLamp(lamp) {
  const place = byId("lamp");
  if (!place || !lamp) return;
  const level = Math.round(100 * lamp.level);
  if (!held) {
    byId("lamp-level").value = level;
    setText(byId("lamp-percent"), `${level} %`);
  }
  byId("lamp-auto").setAttribute("aria-pressed", String(lamp.automatic));
  setText(byId("lamp-text"), words(lamp));
}

async function change(body) {
  try {
    showLamp(await ask("/lamp", { method: "PUT", body }));
    showFailure(byId("lamp-failed"), null);
  } catch (error) {
    showFailure(byId("lamp-failed"), error.message);
  }
}

export function startLamp() {
  const place = byId("lamp");
  if (!place) return;
  const slider = byId("lamp-level");
  slider.addEventListener("input", () => {
    held = true;
    setText(byId("lamp-percent"), `${slider.value} %`);
  });
  slider.addEventListener("change", async () => {
    await change({ level: Number(slider.value) / 100 });
    held = false;
  });
  byId("lamp-auto").addEventListener("click", () => change({ automatic: byId("lamp-auto").getAttribute("aria-pressed") !== "true" }));
  showLamp(JSON.parse(place.dataset.lamp));
}
