// A finished map of a chamber: to look at, take away and delete.

import { data, localTimes, wake } from "./dom.js";
import { startShell } from "./shell.js";
import { StructureViews } from "./structure_views.js";
import { startDeletion } from "./survey_page.js";

const map = data("structure-map");

startShell();
localTimes();
new StructureViews().show(map);
startDeletion(map.survey_id);
wake();
