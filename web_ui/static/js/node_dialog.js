// The dialog in which a manhole is described: its name, and where it is.

import { BoxError, ask } from "./api.js";
import { byId, showFailure } from "./dom.js";
import { IdentifierCheck } from "./identifier_check.js";
import { wantNumber } from "./numbers.js";

const PLACES = { easting: "Easting", northing: "Northing", level: "Level" };

export class NodeDialog {
  // `confirm(title, text, action)` asks before `action` is done.
  constructor(confirm, onChanged) {
    this.onChanged = onChanged;
    this.dialog = byId("node-dialog");
    this.form = byId("node-form");
    const { name } = this.form.elements;
    this.check = new IdentifierCheck({ fields: [name], asked: () => this.asked(), place: byId("node-check"), name });
    byId("node-cancel").addEventListener("click", () => this.dialog.close());
    byId("node-delete").addEventListener("click", () => {
      const { id, name } = this.editing;
      confirm(`Delete the manhole ${name}?`, "Its coordinates go with it.", () => this.does(() => ask(`/nodes/${id}`, { method: "DELETE" })));
    });
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.does(() => this.save());
    });
  }

  asked() {
    const name = this.form.elements.name.value;
    if (!name.trim()) return null;
    const query = new URLSearchParams({ name });
    if (this.editing) query.set("own", this.editing.id);
    return `/nodes/check?${query}`;
  }

  open(node) {
    this.editing = node;
    const fields = this.form.elements;
    byId("node-dialog-title").textContent = node ? `Manhole ${node.name}` : "New manhole";
    byId("node-delete").hidden = !node;
    fields.name.value = node?.name ?? "";
    for (const place of Object.keys(PLACES)) fields[place].value = node?.[place] ?? "";
    showFailure(byId("node-error"), null);
    this.check.now();
    this.dialog.showModal();
    (node ? fields.easting : fields.name).focus();
  }

  async save() {
    const fields = this.form.elements;
    const body = { name: fields.name.value.trim() };
    if (!body.name) throw new BoxError("Name the manhole.");
    for (const [place, word] of Object.entries(PLACES)) body[place] = wantNumber(fields[place].value, word);
    if ((body.easting === null) !== (body.northing === null)) throw new BoxError("Easting and northing: both, or neither.");
    await (this.editing ? ask(`/nodes/${this.editing.id}`, { method: "PATCH", body }) : ask("/nodes", { method: "POST", body }));
  }

  async does(what) {
    for (const button of this.form.querySelectorAll("button")) button.disabled = true;
    try {
      await what();
      this.dialog.close();
      this.onChanged();
    } catch (error) {
      showFailure(byId("node-error"), error.message);
    } finally {
      for (const button of this.form.querySelectorAll("button")) button.disabled = false;
    }
  }
}
