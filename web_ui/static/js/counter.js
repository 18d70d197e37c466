// The counter of the tether: counts per metre, direction, zero, calibration over a known length.

import { ask } from "./api.js";
import { announce, byId, html, setText, showFailure, toast } from "./dom.js";
import { metresText } from "./drive_words.js";
import { readNumber } from "./numbers.js";

const FIRST = "First point: press, then drive the known length.";
const SECOND = "First point is set. Drive the known length, type it, press End here.";

export class Counter {
  constructor() {
    this.encoder = null;
    this.idle = true;
    this.calibrating = false;
    byId("counter-form").addEventListener("submit", (event) => {
      event.preventDefault();
      this.set();
    });
    byId("zero").addEventListener("click", () => this.send("/encoder/zero", "POST", {}, "The chainage is zero here."));
    byId("calibrate-start").addEventListener("click", async () => {
      if (await this.send("/encoder/calibrate", "POST", { point: "start" }, "First point set.")) this.step(true);
    });
    byId("calibrate-end").addEventListener("click", () => this.calibrateEnd());
    byId("counter-details").addEventListener("toggle", () => this.fill());
  }

  show(encoder, idle) {
    const first = this.encoder === null;
    this.encoder = encoder;
    this.idle = idle;
    byId("counter").hidden = encoder === null;
    if (encoder === null) return;
    if (first) this.fill();
    if (encoder.calibrating !== undefined) this.step(encoder.calibrating);
    byId("counter-busy").hidden = idle;
    for (const id of ["counter-save", "zero", "calibrate-start"]) byId(id).disabled = !idle;
    byId("calibrate-end").disabled = !idle || !this.calibrating;
    if (!byId("counter-details").open) return;
    const facts = [
      ["Counts now", encoder.counts === null ? "–" : `${encoder.counts}`],
      ["Counts per metre", String(Number(encoder.counts_per_metre.toPrecision(7)))],
      ...(encoder.metres === null || encoder.metres === undefined ? [] : [["Chainage now", `${metresText(encoder.metres)} m`]]),
    ];
    const key = JSON.stringify(facts);
    if (key !== this.facts) byId("counter-facts").replaceChildren(...facts.map(([name, value]) => html("div", {}, [html("dt", {}, name), html("dd", {}, value)])));
    this.facts = key;
  }

  fill() {
    if (!this.encoder) return;
    byId("counts-per-metre").value = String(Number(this.encoder.counts_per_metre.toPrecision(7)));
    byId("counter-direction").value = String(this.encoder.direction);
  }

  step(started) {
    this.calibrating = started;
    setText(byId("calibrate-step"), started ? SECOND : FIRST);
    byId("calibrate-end").disabled = !started || !this.idle;
  }

  number(id, name) {
    const value = readNumber(byId(id).value);
    if (value === null || !(value > 0)) {
      showFailure(byId("counter-error"), `${name}: a number above 0.`);
      byId(id).focus();
      return null;
    }
    return value;
  }

  set() {
    const counts = this.number("counts-per-metre", "Counts per metre");
    if (counts === null) return;
    this.send("/encoder", "PUT", { counts_per_metre: counts, direction: Number(byId("counter-direction").value) }, "The counter is set.");
  }

  async calibrateEnd() {
    const length = this.number("calibrate-length", "Length driven");
    if (length === null) return;
    if (await this.send("/encoder/calibrate", "POST", { point: "end", length_m: length }, "The counter is calibrated.")) {
      this.step(false);
      byId("calibrate-length").value = "";
      this.fill();
    }
  }

  async send(path, method, body, done) {
    try {
      const encoder = await ask(path, { method, body });
      showFailure(byId("counter-error"), null);
      this.show(encoder, this.idle);
      announce(done);
      toast(done);
      return true;
    } catch (error) {
      showFailure(byId("counter-error"), error.message);
      return false;
    }
  }
}
