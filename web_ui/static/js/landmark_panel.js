// One landmark opened: its picture, what it may be, how sure, who said what; confirm, reject, correct, note, undo.

import { ask } from "./api.js";
import { announce, byId, html, setText, showFailure, toast } from "./dom.js";
import { HALF_HOURS, NOTHING, chainageText, className, clockText, inNetwork, metresText, seenText, sentence, shown, sigmaOf, sigmaText, whereText } from "./drive_words.js";
import { readNumber } from "./numbers.js";
import { recall, remember } from "./operator.js";

const percent = (share) => (share > 0.995 && share < 1 ? "> 99 %" : share > 0 && share < 0.005 ? "< 1 %" : `${Math.round(share * 100)} %`);

export class LandmarkPanel {
  // surveyId() names the survey, onChange(landmark) is called with what the box made of a change.
  constructor({ surveyId, onChange }) {
    Object.assign(this, { surveyId, onChange });
    this.landmark = null;
    this.dialog = byId("landmark-dialog");
    this.form = byId("lm-form");
    byId("lm-close").addEventListener("click", () => this.dialog.close());
    byId("lm-confirm").addEventListener("click", () => this.decide("confirmed"));
    byId("lm-reject").addEventListener("click", () => this.decide("rejected"));
    byId("lm-heat").addEventListener("click", () => {
      byId("lm-heat").setAttribute("aria-pressed", String(!this.heat()));
      this.picture(this.landmark);
    });
    byId("lm-undo").addEventListener("click", () => this.decide(null));
    this.dialog.addEventListener("close", () => (this.landmark = null));
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.correct();
    });
  }

  open(landmark) {
    this.landmark = landmark;
    this.pictured = null;
    showFailure(byId("lm-error"), null);
    this.draw();
    this.fill();
    if (!this.dialog.open) this.dialog.showModal();
    this.dialog.scrollTop = 0;
    byId("lm-close").focus();
  }

  // What the drive has learned of it meanwhile; the form keeps what is being typed.
  update(landmark) {
    if (this.landmark?.id !== landmark.id) return;
    this.landmark = landmark;
    this.draw();
  }

  draw() {
    const landmark = this.landmark;
    const view = shown(landmark);
    setText(byId("lm-title"), `${view.id} ${sentence(view.class)}`);
    this.picture(landmark);
    const facts = [
      ["Chainage", chainageText(view)],
      ["Clock", view.clock === null ? "not known" : whereText(view)],
      ["Sure to", [sigmaText(sigmaOf(landmark)), landmark.sigma_clock === null ? "" : `± ${Math.round(landmark.sigma_clock * 60)} min of the clock`].filter(Boolean).join(", ") || "not known"],
      ["Seen", landmark.marked_by_hand ? "marked by hand" : `${seenText(landmark)}, ${landmark.status}`],
    ];
    if (landmark.corrected) facts.push(["Measured", `${landmark.class}, ${chainageText(shown({ ...landmark, corrected: null }))}, ${whereText(shown({ ...landmark, corrected: null }))}`]);
    const key = JSON.stringify(facts);
    if (this.facts !== key) byId("lm-facts").replaceChildren(...facts.map(([name, value]) => html("div", {}, [html("dt", {}, name), html("dd", {}, value)])));
    this.facts = key;
    byId("lm-confirm").setAttribute("aria-pressed", String(landmark.decision === "confirmed"));
    byId("lm-reject").setAttribute("aria-pressed", String(landmark.decision === "rejected"));
    byId("lm-undo").hidden = !landmark.decision;
    const beliefs = Object.entries(landmark.belief ?? {}).sort(([, a], [, b]) => b - a);
    byId("lm-belief").replaceChildren(...beliefs.map(([name, share]) => this.bar(name, share)));
    byId("lm-said").replaceChildren(...this.said(landmark));
  }

  heat() {
    return byId("lm-heat").getAttribute("aria-pressed") === "true";
  }

  picture(landmark) {
    const known = inNetwork(landmark.class);
    byId("lm-heat").hidden = !landmark.thumbnail || !known;
    const heat = known && this.heat() ? `?heatmap=${encodeURIComponent(landmark.class)}` : "";
    const address = landmark.thumbnail ? `/api/v1/surveys/${this.surveyId()}/landmarks/${landmark.id}/thumbnail.jpg${heat}` : "";
    if (address === this.pictured) return;
    this.pictured = address;
    const place = byId("lm-figure");
    if (address) place.replaceChildren(html("img", { src: address, alt: heat ? `Picture of landmark ${landmark.id}, bright where the network sees ${className(landmark.class)}` : `Picture of landmark ${landmark.id}` }));
    else place.replaceChildren(html("p", { class: "small" }, landmark.marked_by_hand ? "No picture: marked by hand." : "No picture yet."));
  }

  bar(name, share) {
    const text = percent(share);
    return html("div", { class: name === NOTHING ? "bar-row none" : "bar-row" }, [
      html("span", { class: "bar-name" }, sentence(className(name))),
      html("progress", { max: 1, value: share, "aria-label": `${className(name)} ${text}` }),
      html("span", { class: "bar-share" }, text),
    ]);
  }

  said(landmark) {
    const best = Object.entries(landmark.belief ?? {}).reduce((a, b) => (b[1] > a[1] ? b : a), ["", 0]);
    const rows = [html("li", {}, landmark.marked_by_hand ? `Marked by hand as ${landmark.class}` : `Box: ${className(best[0])}, ${percent(best[1])}`)];
    for (const word of landmark.history ?? []) {
      const parts = [];
      if ("decision" in word) parts.push(word.decision ?? "decision taken back");
      for (const [key, name, text] of [["class", "class", String], ["chainage_m", "chainage", (v) => `${metresText(v)} m`], ["clock", "clock", clockText]])
        if (key in word) parts.push(word[key] === null ? `${name} as measured` : `${name} ${text(word[key])}`);
      if (word.note) parts.push(`“${word.note}”`);
      else if ("note" in word && !parts.length) parts.push("note taken back");
      const when = word.created ? new Intl.DateTimeFormat("en-GB", { dateStyle: "short", timeStyle: "short" }).format(new Date(word.created)) : "";
      rows.push(html("li", {}, `${word.by || "Operator"}${when ? `, ${when}` : ""}: ${parts.join(", ")}`));
    }
    return rows;
  }

  fill() {
    const landmark = this.landmark;
    const fields = this.form.elements;
    fields.class.value = landmark.corrected?.class ?? "";
    fields.class.placeholder = landmark.class;
    fields.chainage_m.value = landmark.corrected?.chainage_m ?? "";
    fields.chainage_m.placeholder = metresText(landmark.chainage_m);
    const measured = landmark.clock === null ? "not known" : `${clockText(landmark.clock)} measured`;
    const chosen = landmark.corrected?.clock ?? null;
    const hours = chosen === null || HALF_HOURS.includes(chosen) ? HALF_HOURS : [chosen, ...HALF_HOURS];
    fields.clock.replaceChildren(html("option", { value: "" }, measured), ...hours.map((hour) => html("option", { value: hour }, clockText(hour))));
    fields.clock.value = chosen === null ? "" : String(chosen);
    fields.note.value = landmark.note ?? "";
    fields.by.value = fields.by.value || recall();
  }

  async decide(decision) {
    if (await this.send({ decision })) {
      const words = { confirmed: "Confirmed.", rejected: "Rejected." }[decision] ?? "Decision taken back.";
      announce(words);
      if (decision === null) byId("lm-confirm").focus(); // the button that was pressed is gone
    }
  }

  async correct() {
    const fields = this.form.elements;
    const chainage = readNumber(fields.chainage_m.value);
    if (Number.isNaN(chainage)) {
      showFailure(byId("lm-error"), "Chainage: a number of metres, or nothing.");
      fields.chainage_m.focus();
      return;
    }
    const said = {
      class: fields.class.value.trim() || null,
      chainage_m: chainage,
      clock: fields.clock.value ? Number(fields.clock.value) : null,
    };
    const before = this.landmark.corrected ?? {};
    const change = Object.fromEntries(Object.entries(said).filter(([key, value]) => value !== (before[key] ?? null)));
    if (fields.note.value.trim() !== (this.landmark.note ?? "")) change.note = fields.note.value.trim();
    if (!Object.keys(change).length) {
      this.dialog.close();
      return;
    }
    if (await this.send(change)) {
      this.dialog.close();
      announce("Saved.");
      toast("Saved.");
    }
  }

  async send(change) {
    const { id } = this.landmark;
    const by = this.form.elements.by.value.trim();
    try {
      const landmark = await ask(`/surveys/${this.surveyId()}/landmarks/${id}`, { method: "PATCH", body: { ...change, by } });
      showFailure(byId("lm-error"), null);
      if (by) remember(by);
      this.onChange(landmark);
      return true;
    } catch (error) {
      showFailure(byId("lm-error"), error.message);
      byId("lm-error").scrollIntoView({ block: "nearest" });
      return false;
    }
  }
}
