// Choosing, creating and editing the pipe and its manholes, in one place.

import { BoxError, ask } from "./api.js";
import { byId, data, html, showFailure } from "./dom.js";

const label = (pipe) => [pipe.name, pipe.reference_dn ? `DN ${pipe.reference_dn}` : "", pipe.material === "unknown" ? "" : pipe.material].filter(Boolean).join(" · ");

// Digits only, so that a slip such as "4oo" is told and not cut to 4.
export function readDn(text) {
  const digits = text.trim().replace(/^DN\s*/i, "");
  if (!digits) return null;
  if (!/^\d{1,4}$/.test(digits) || Number(digits) < 50 || Number(digits) > 4000) throw new BoxError("DN on the map: a number from 50 to 4000, or nothing.");
  return Number(digits);
}

export class PipeChooser {
  constructor(onChange) {
    const { pipes, nodes } = data("pipes-data");
    this.pipes = new Map(pipes.map((pipe) => [pipe.id, pipe]));
    this.nodes = nodes;
    this.onChange = onChange;
    this.select = byId("pipe");
    this.dialog = byId("pipe-dialog");
    this.form = byId("pipe-form");
    this.select.addEventListener("change", () => this.changed());
    byId("pipe-new").addEventListener("click", () => this.open(null));
    byId("pipe-edit").addEventListener("click", () => this.open(this.chosen));
    byId("pipe-cancel").addEventListener("click", () => this.dialog.close());
    this.form.addEventListener("submit", (event) => {
      event.preventDefault();
      this.save();
    });
    this.changed();
  }

  get chosen() {
    return this.pipes.get(Number(this.select.value)) ?? null;
  }

  set disabled(value) {
    this.select.disabled = value;
    byId("pipe-new").disabled = value;
    byId("pipe-edit").disabled = value || !this.chosen;
  }

  changed() {
    byId("pipe-edit").disabled = this.select.disabled || !this.chosen;
    this.onChange(this.chosen);
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
    fields.note.value = pipe?.note ?? "";
    showFailure(byId("pipe-error"), null);
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
      const [start, end] = [fields.start.value.trim(), fields.end.value.trim()];
      const name = fields.name.value.trim() || [start, end].filter(Boolean).join(" – ");
      if (!name) throw new BoxError("Name the pipe, or one of its manholes.");
      const body = {
        name,
        reference_dn: readDn(fields.reference_dn.value),
        start_node: await this.node(start),
        end_node: await this.node(end),
        material: fields.material.value,
        shape: fields.shape.value,
        note: fields.note.value,
      };
      const pipe = this.editing
        ? await ask(`/pipes/${this.editing.id}`, { method: "PATCH", body })
        : await ask("/pipes", { method: "POST", body });
      this.put(pipe);
      this.dialog.close();
    } catch (error) {
      showFailure(byId("pipe-error"), error.message);
    } finally {
      button.disabled = false;
    }
  }

  put(pipe) {
    this.pipes.set(pipe.id, pipe);
    const old = [...this.select.options].find((option) => option.value === String(pipe.id));
    const option = old ?? html("option", { value: String(pipe.id) });
    option.textContent = label(pipe);
    if (!old) this.select.append(option);
    this.select.value = String(pipe.id);
    this.changed();
  }
}
