// An identifier judged by the box while it is typed: whether it is free, and what is odd about it.

import { ask } from "./api.js";
import { setData, setText } from "./dom.js";

const PAUSE_MS = 250;

// `fields` are watched, `asked()` gives the path to ask (or null for nothing to say), `place` shows the answer, `name` is marked.
export class IdentifierCheck {
  constructor({ fields, asked, place, name }) {
    Object.assign(this, { asked, place, name, turn: 0 });
    for (const field of fields) field.addEventListener("input", () => this.soon());
  }

  soon() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.now(), PAUSE_MS);
  }

  async now() {
    clearTimeout(this.timer);
    const path = this.asked();
    const turn = ++this.turn; // an answer that was overtaken is not shown
    if (!path) return this.show(null);
    try {
      const judged = await ask(path);
      if (turn === this.turn) this.show(judged);
    } catch {
      if (turn === this.turn) this.show(null); // saving asks again, and tells what is wrong
    }
  }

  show(judged) {
    const state = !judged ? "none" : judged.error ? "refused" : judged.warnings.length ? "doubtful" : "free";
    setData(this.place, "state", state);
    setText(this.place, { none: "", refused: judged?.error, doubtful: judged?.warnings.join(" "), free: `${judged?.name} is free.` }[state]);
    this.name.setAttribute("aria-invalid", String(state === "refused"));
    if (judged?.name && !this.name.value) this.name.placeholder = judged.name;
  }
}
