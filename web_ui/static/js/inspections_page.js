// The list of reports: begin one, undo a deletion.

import { ask } from "./api.js";
import { byId, wake } from "./dom.js";
import { startShell } from "./shell.js";

startShell();
byId("filter-pipe").addEventListener("change", (event) => event.target.form.requestSubmit());

byId("begin").addEventListener("submit", async (event) => {
  event.preventDefault();
  const fields = event.target.elements;
  const failed = byId("begin-failed");
  failed.hidden = true;
  try {
    const body = { pipe_id: Number(fields.pipe_id.value), operator: fields.operator.value, direction: fields.direction.value };
    const begun = await ask("/inspections", { method: "POST", body });
    location.assign(`/inspections/${begun.id}`);
  } catch (error) {
    failed.textContent = error.message;
    failed.hidden = false;
  }
});

const undo = byId("undo");
undo?.querySelector("button").addEventListener("click", async () => {
  try {
    await ask(`/inspections/${undo.dataset.inspection}/restore`, { method: "POST" });
    location.assign(`/inspections/${undo.dataset.inspection}`);
  } catch (error) {
    undo.querySelector("p").textContent = error.message;
  }
});
wake();
