// A measurement or scan that runs by itself to its end: the panel that shows it, its cancelling, and what becomes of it.

import { ask } from "./api.js";
import { announce, byId, setText, showFailure } from "./dom.js";

const now = () => performance.now();

// `kind` as events name it; `path` is where it is begun, and below it cancelled; `noun` is what it is called; `lock(running)`
// closes what must not change meanwhile; `describe(survey)` gives { word, count, value (null: unknown), max } of the progress;
// after `silenceMs` without news of it the box is asked what became of it.
export class Running {
  constructor({ kind, path, noun, doing, lock, describe, silenceMs }) {
    Object.assign(this, { kind, path, noun, doing, lock, describe, silenceMs, survey: null });
    byId("cancel").addEventListener("click", () => this.cancel());
  }

  get on() {
    return this.survey !== null;
  }

  show(survey) {
    const started = !this.on;
    this.survey = { id: survey.survey_id, heard: now() };
    byId("idle").hidden = true;
    byId("running").hidden = false;
    this.lock(true);
    const { word, count, value, max } = this.describe(survey);
    setText(byId("running-word"), word);
    setText(byId("running-count"), count);
    const bar = byId("progress");
    bar.max = max;
    if (value === null) bar.removeAttribute("value");
    else bar.value = value;
    if (!started) return;
    announce(`${this.doing}. Hold the box still.`);
    showFailure(byId("failed"), null);
    if (document.activeElement === document.body || document.activeElement === byId("start")) byId("cancel").focus();
  }

  end(message, failed) {
    if (this.on && byId("running").contains(document.activeElement)) setTimeout(() => byId("start").focus());
    this.survey = null;
    byId("idle").hidden = false;
    byId("running").hidden = true;
    this.lock(false);
    showFailure(byId("failed"), failed ? message : null);
    if (!failed && message) announce(message);
  }

  finished(surveyId) {
    announce("Saved.");
    location.assign(`/surveys/${surveyId}`);
  }

  // What the box says now and then of what it is doing.
  heard(survey) {
    if (survey.state !== "idle") this.show(survey);
    else if (this.on && now() - this.survey.heard > this.silenceMs) this.findOut();
  }

  // What the box says of its steps and its end.
  event(event) {
    if (event.kind !== this.kind) return; // another survey's
    if (event.state === "measuring" || event.state === "computing") this.show(event);
    else if (event.state === "saved" && this.on) this.finished(event.survey_id);
    else if (event.state === "cancelled") this.end(event.message || `The ${this.noun} was cancelled.`, false);
    else if (event.state === "failed") this.end(event.message || `The ${this.noun} failed.`, true);
  }

  // What to do about one that failed; one that is saved says so on its own page.
  prompt(prompt) {
    if (prompt.kind === this.kind && !byId("failed").hidden) showFailure(byId("failed"), `${prompt.reason} ${prompt.remedy}`);
  }

  // The stream may have been away when it ended: then the box is asked what became of it.
  async findOut() {
    const { id } = this.survey;
    try {
      await ask(`/surveys/${id}`);
      this.finished(id);
    } catch (error) {
      this.end(error.status === 404 ? `The ${this.noun} ended without a result.` : error.message, true);
    }
  }

  // Begin one: `body()` may throw a sentence.
  async start(body, wanted) {
    byId("start").disabled = true;
    showFailure(byId("failed"), null);
    try {
      const { survey_id: surveyId } = await ask(this.path, { method: "POST", body: body() });
      if (!this.on) this.show({ survey_id: surveyId, state: "measuring", frames_done: 0, frames_wanted: wanted });
    } catch (error) {
      showFailure(byId("failed"), error.message);
    } finally {
      byId("start").disabled = false;
    }
  }

  async cancel() {
    try {
      await ask(`${this.path}/cancel`, { method: "POST" });
    } catch (error) {
      showFailure(byId("failed"), error.message);
    }
  }
}
