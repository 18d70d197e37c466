// The list of landmarks with its filter. Rows are changed in place: a tap must not land on a row that has just moved its neighbour.

import { byId, html, icon, setData, setIcon, setText } from "./dom.js";
import { STATUSES, chainageText, seenText, sentence, sigmaOf, sigmaText, slug, symbol, whereText } from "./drive_words.js";

export class LandmarkList {
  // onPick(id) opens one; `newestFirst` puts what the crawler has just seen on top.
  constructor({ surveyId, onPick, newestFirst = false }) {
    Object.assign(this, { surveyId, onPick, newestFirst });
    this.rows = new Map();
    this.place = byId("landmarks");
    this.views = [];
    for (const name of ["filter-class", "filter-status"]) byId(name).addEventListener("change", () => this.draw());
  }

  set(views) {
    this.views = views;
    this.classes();
    this.draw();
  }

  classes() {
    const select = byId("filter-class");
    const known = new Set([...select.options].map((option) => option.value));
    for (const name of new Set(this.views.map((view) => view.class))) if (!known.has(name)) select.append(html("option", { value: name }, sentence(name)));
  }

  get filtered() {
    const [label, status] = [byId("filter-class").value, byId("filter-status").value];
    return this.views.filter((view) => (!label || view.class === label) && (!status || view.status === status));
  }

  draw() {
    const order = (a, b) => a.chainage_m - b.chainage_m || a.id - b.id;
    const wanted = this.filtered.sort((a, b) => (this.newestFirst ? order(b, a) : order(a, b)));
    const elements = wanted.map((view) => this.row(view));
    const keep = new Set(elements);
    for (const element of [...this.place.children]) if (!keep.has(element)) element.remove();
    elements.forEach((element, index) => {
      if (this.place.children[index] !== element) this.place.insertBefore(element, this.place.children[index] ?? null);
    });
    const all = this.views.length;
    setText(byId("list-count"), all === wanted.length ? `${all}` : `${wanted.length} of ${all}`);
    const empty = byId("list-empty");
    empty.hidden = wanted.length > 0;
    setText(empty, all ? "None of this kind." : "Nothing found yet.");
  }

  row(view) {
    let known = this.rows.get(view.id);
    if (!known) {
      const parts = {
        thumb: html("span", { class: "lm-thumb" }, icon(symbol(view.class))),
        symbol: html("span", { class: "lm-symbol" }, icon(symbol(view.class))),
        title: html("span", { class: "lm-class" }),
        where: html("span", { class: "lm-where" }),
        how: html("span", { class: "lm-how" }),
        status: html("span", { class: "lm-status" }),
      };
      const button = html("button", { type: "button", class: "lm-row", "data-id": view.id }, [
        parts.thumb,
        html("span", { class: "lm-main" }, [html("span", { class: "lm-line" }, [parts.symbol, parts.title, parts.status]), parts.where, parts.how]),
      ]);
      button.addEventListener("click", () => this.onPick(view.id));
      known = { element: html("li", {}, button), button, ...parts, pictured: "" };
      this.rows.set(view.id, known);
    }
    setIcon(known.symbol, symbol(view.class));
    setData(known.button, "class", slug(view.class));
    setData(known.button, "status", view.status);
    setData(known.button, "decision", view.decision ?? "none");
    setText(known.title, `${view.id} ${sentence(view.class)}`);
    setText(known.where, `${chainageText(view)} ${sigmaText(sigmaOf(view))} · ${whereText(view)}`);
    setText(known.how, view.marked_by_hand ? "marked by hand" : seenText(view));
    const said = view.decision === "rejected" ? "rejected" : view.decision === "confirmed" ? "✓ confirmed by hand" : (STATUSES[view.status] ?? view.status);
    setText(known.status, view.corrected ? `${said}, corrected` : said);
    const picture = view.thumbnail ? `/api/v1/surveys/${this.surveyId}/landmarks/${view.id}/thumbnail.jpg` : "";
    if (picture !== known.pictured) {
      known.pictured = picture;
      known.thumb.replaceChildren(picture ? html("img", { src: picture, alt: "", loading: "lazy", width: 72, height: 58 }) : icon(symbol(view.class)));
    }
    return known.element;
  }
}
