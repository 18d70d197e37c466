// Choosing the pipe that is looked at; describing a new one or another one's data is the dialog's.

import { byId, data, html } from "./dom.js";
import { PipeDialog } from "./pipe_dialog.js";

const label = (pipe) => [pipe.name, pipe.reference_dn ? `DN ${pipe.reference_dn}` : "", pipe.material === "unknown" ? "" : pipe.material].filter(Boolean).join(" · ");

export class PipeChooser {
  constructor(onChange) {
    const { pipes, nodes } = data("pipes-data");
    this.pipes = new Map(pipes.map((pipe) => [pipe.id, pipe]));
    this.onChange = onChange;
    this.select = byId("pipe");
    this.dialog = new PipeDialog(nodes, (pipe) => this.put(pipe));
    this.select.addEventListener("change", () => this.changed());
    byId("pipe-new").addEventListener("click", () => this.dialog.open(null));
    byId("pipe-edit").addEventListener("click", () => this.dialog.open(this.chosen));
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
