// The history: local times, the filter without its button, undo of a deletion.

import { ask } from "./api.js";
import { byId, html, localTimes, wake } from "./dom.js";
import { startShell } from "./shell.js";

startShell();
localTimes();
byId("filter-pipe").addEventListener("change", (event) => event.target.form.requestSubmit());

const undo = byId("undo");
undo?.querySelector("button").addEventListener("click", async (event) => {
  event.target.disabled = true;
  try {
    await ask(`/surveys/${undo.dataset.survey}/restore`, { method: "POST" });
    location.assign("/surveys");
  } catch (error) {
    undo.replaceChildren(html("p", { class: "failed", role: "alert" }, error.message));
  }
});
wake();
