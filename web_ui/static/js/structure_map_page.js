// A finished map of a chamber: to look at, take away and delete.

import { ask } from "./api.js";
import { byId, data, localTimes, showFailure, wake } from "./dom.js";
import { startShell } from "./shell.js";
import { StructureViews } from "./structure_views.js";

const map = data("structure-map");

async function remove() {
  byId("delete-confirm").disabled = true;
  try {
    await ask(`/surveys/${map.survey_id}`, { method: "DELETE" });
    location.assign(`/surveys?deleted=${map.survey_id}`);
  } catch (error) {
    showFailure(byId("delete-error"), error.message);
    byId("delete-confirm").disabled = false;
  }
}

startShell();
localTimes();
new StructureViews().show(map);
byId("delete").addEventListener("click", () => byId("delete-dialog").showModal());
byId("delete-confirm").addEventListener("click", remove);
wake();
