// A finished drive: its map to look at, correct, print and delete.

import { byId, data, localTimes, setText, wake } from "./dom.js";
import { LandmarkViews } from "./landmark_views.js";
import { startShell } from "./shell.js";
import { startDeletion } from "./survey_page.js";

const map = data("map-data");
const views = new LandmarkViews({ surveyId: map.survey_id });

function count() {
  const found = views.views.filter((view) => !view.rejected && view.status !== "candidate").length;
  setText(byId("found-count"), found === 0 ? "No landmarks" : found === 1 ? "1 landmark" : `${found} landmarks`);
}

startShell();
localTimes();
views.onDraw = count;
views.load(map);
startDeletion(map.survey_id);
wake();
