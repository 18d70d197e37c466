// The result page: drawings, the point cloud when asked for, the operator's answers, deletion.

import { ask } from "./api.js";
import { boxPlot } from "./box_plot.js";
import { crossSection } from "./cross_section.js";
import { announce, byId, data, html, localTimes, showFailure, toast, wake } from "./dom.js";
import { recall, remember } from "./operator.js";
import { startShell } from "./shell.js";
import { openCloud, startDeletion } from "./survey_page.js";

const { id, result } = data("survey-data");

function draw(place, drawing, instead) {
  place?.replaceChildren(drawing ?? html("p", {}, instead));
}

// The server words the verdict; after an answer its page is asked for again and the parts that can change are put in place.
async function refresh() {
  const response = await fetch(location.pathname, { cache: "no-store" });
  const fresh = new DOMParser().parseFromString(await response.text(), "text/html");
  for (const selector of ["#verdict", ".section-record"]) {
    const part = fresh.querySelector(selector);
    if (part) document.querySelector(selector).replaceWith(part);
  }
  localTimes();
}

const yesNo = { yes: true, no: false };

async function answer(event) {
  event.preventDefault();
  const form = byId("answer-form");
  const fields = new FormData(form);
  const body = { verdict: fields.get("verdict"), by: fields.get("by").trim(), note: fields.get("note") };
  for (const question of result.questions) body[question.code] = yesNo[fields.get(question.code)] ?? null;
  if (body.verdict && !body.by) {
    showFailure(byId("answer-error"), "Your name: a verdict needs one.");
    byId("by").focus();
    return;
  }
  try {
    await ask(`/surveys/${id}/answer`, { method: "POST", body });
    showFailure(byId("answer-error"), null);
    remember(body.by);
    await refresh();
    byId("verdict").scrollIntoView({ block: "nearest" });
    announce("Your answers are saved.");
    toast("Your answers are saved.");
  } catch (error) {
    showFailure(byId("answer-error"), error.message);
  }
}

startShell();
localTimes();
startDeletion(id);
if (result) {
  draw(byId("cross"), crossSection(result), "No cross-section.");
  draw(byId("boxes"), boxPlot(result.frames, result.interval_mm), "No frame gave a diameter.");
  byId("cloud-show").addEventListener("click", () => openCloud(id));
  byId("answer-form").addEventListener("submit", answer);
  if (!byId("by").value) byId("by").value = recall();
}
wake();
