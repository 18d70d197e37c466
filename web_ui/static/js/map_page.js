// A finished drive: its map to look at, correct, print and delete.

import { ask } from "./api.js";
import { byId, data, localTimes, setText, showFailure, wake } from "./dom.js";
import { LandmarkViews } from "./landmark_views.js";
import { startShell } from "./shell.js";

const map = data("map-data");
const views = new LandmarkViews({ surveyId: map.survey_id });

function count() {
  const found = views.views.filter((view) => !view.rejected && view.status !== "candidate").length;
  setText(byId("found-count"), found === 0 ? "No landmarks" : found === 1 ? "1 landmark" : `${found} landmarks`);
}

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
views.onDraw = count;
views.load(map);
byId("delete").addEventListener("click", () => byId("delete-dialog").showModal());
byId("delete-confirm").addEventListener("click", remove);
wake();
