// The page of what happened while nobody looked: the switch, its state as it is, and the button that says that it was read.

import { ask } from "./api.js";
import { byId, data, html, localTimes, setData, setText, showFailure, wake } from "./dom.js";
import { startShell } from "./shell.js";

const STATES = {
  off: "Off: surveys begin when somebody says so.",
  waiting: "Waits for a pipe to come into view.",
  surveying: "Surveys a pipe.",
  aside: "Stands aside: somebody drives by hand.",
  held: "Begins no survey for now.",
};

function show(state) {
  setData(byId("alone-state"), "state", state.state);
  const survey = state.state === "surveying" && state.survey_id ? ` It is survey ${state.survey_id}.` : "";
  setText(byId("alone-state").querySelector("span"), (STATES[state.state] ?? state.state) + survey);
  byId("alone-switch").setAttribute("aria-pressed", String(state.on));
  setText(byId("alone-switch"), state.on ? "On: stop logging by itself" : "Off: log by itself");
  const holds = state.holds.join("\n");
  if (byId("alone-holds").dataset.shown !== holds) {
    byId("alone-holds").dataset.shown = holds;
    byId("alone-holds").replaceChildren(...state.holds.map((text) => html("li", {}, text)));
  }
}

const feed = startShell();
feed.on("status", (status) => {
  if (status.autonomy) show(status.autonomy);
});
localTimes();
show(data("alone-data"));

async function attempt(action) {
  try {
    await action();
    showFailure(byId("alone-failed"), null);
  } catch (error) {
    showFailure(byId("alone-failed"), error.message);
  }
}

byId("alone-switch").addEventListener("click", () =>
  attempt(async () => show(await ask("/alone", { method: "PUT", body: { on: byId("alone-switch").getAttribute("aria-pressed") !== "true" } }))),
);
byId("alone-read")?.addEventListener("click", (event) =>
  attempt(async () => {
    await ask("/alone/looked", { method: "POST", body: { entry: Number(event.target.dataset.entry) } });
    location.reload();
  }),
);
wake();
