// The dialog in which a pipe is described: new or edited, its manholes made as they are named.

import { BoxError, ask } from "./api.js";
import { byId, html, showFailure } from "./dom.js";
import { IdentifierCheck } from "./identifier_check.js";
import { wantNumber } from "./numbers.js";

// Digits only, so that a slip such as "4oo" is told and not cut to 4.
function readDn(text) {
  const digits = text.trim().replace(/^DN\s*/i, "");
  if (!digits) return null;
  if (!/^\d{1,4}$/.test(digits) || Number(digits) < 50 || Number(digits) > 4000) throw new BoxError("DN on the map: a number from 50 to 4000, or nothing.");
  return Number(digits);
}

export class PipeDialog {
  constructor(nodes, onSaved) {
    this.nodes = nodes;
    this.onSaved = onSaved;
    this.dialog = byId("pipe-dialog");
    this.form = byId("pipe-form");
    const { start, end, name } = this.form.elements;
    this.unnamed = name.placeholder;
    this.check = new IdentifierCheck({ fields: [start, end, name], asked: () => this.asked(), place: byId("pipe-check"), name });
    byId("pipe-cancel").addEventListener("click", () => this.dialog.close());
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.save();
    });
  }

  asked() {
    const { start, end, name } = this.form.elements;
    if (!start.value.trim() && !end.value.trim() && !name.value.trim()) {
      name.placeholder = this.unnamed;
      return null;
    }
    const query = new URLSearchParams({ upstream: start.value, downstream: end.value, name: name.value });
    if (this.editing) query.set("own", this.editing.id);
    return `/pipes/check?${query}`;
  }

  nodeName(id) {
    return this.nodes.find((node) => node.id === id)?.name ?? "";
  }

  open(pipe) {
    this.editing = pipe;
    const fields = this.form.elements;
    byId("pipe-dialog-title").textContent = pipe ? "Edit pipe" : "New pipe";
    fields.start.value = pipe ? this.nodeName(pipe.start_node) : "";
    fields.end.value = pipe ? this.nodeName(pipe.end_node) : "";
    fields.name.value = pipe?.name ?? "";
    fields.material.value = pipe?.material ?? "unknown";
    fields.shape.value = pipe?.shape ?? "circular";
    fields.reference_dn.value = pipe?.reference_dn ?? "";
    fields.length_m.value = pipe?.length_m ?? "";
    fields.note.value = pipe?.note ?? "";
    showFailure(byId("pipe-error"), null);
    this.check.now();
    this.dialog.showModal();
    (pipe ? fields.name : fields.start).focus();
  }

  async node(name) {
    const wanted = name.trim();
    if (!wanted) return null;
    const known = this.nodes.find((node) => node.name === wanted);
    if (known) return known.id;
    const created = await ask("/nodes", { method: "POST", body: { name: wanted } });
    this.nodes.push(created);
    byId("node-names").append(html("option", { value: created.name }));
    return created.id;
  }

  async save() {
    const fields = this.form.elements;
    const button = byId("pipe-save");
    button.disabled = true;
    try {
      const described = {
        reference_dn: readDn(fields.reference_dn.value),
        length_m: wantNumber(fields.length_m.value, "Length"),
        material: fields.material.value,
        shape: fields.shape.value,
        note: fields.note.value,
      };
      // Judged before the manholes are made, so that a pipe that is refused leaves none behind.
      const judged = await ask(this.asked() ?? "/pipes/check");
      if (judged.error) throw new BoxError(judged.error);
      const body = {
        ...described,
        name: judged.name,
        start_node: await this.node(fields.start.value),
        end_node: await this.node(fields.end.value),
      };
      const pipe = this.editing
        ? await ask(`/pipes/${this.editing.id}`, { method: "PATCH", body })
        : await ask("/pipes", { method: "POST", body });
      this.dialog.close();
      this.onSaved(pipe);
    } catch (error) {
      showFailure(byId("pipe-error"), error.message);
    } finally {
      button.disabled = false;
    }
  }
}
