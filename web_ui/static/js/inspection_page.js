// One report: which surveys are in it, its observations, its files.

import { ask } from "./api.js";
import { byId, wake } from "./dom.js";
import { startShell } from "./shell.js";

startShell();
const number = byId("inspection").dataset.number;
const observations = JSON.parse(byId("observations").textContent);
const editor = byId("editor");
const fields = byId("editor-form").elements;
let edited = -1;

function say(place, error) {
  place.textContent = error.message;
  place.hidden = false;
}

// Every change is answered by the whole report: the page is drawn anew from it.
async function change(path, method, body, place = byId("failed")) {
  place.hidden = true;
  try {
    await ask(`/inspections/${number}${path}`, { method, body });
    location.reload();
  } catch (error) {
    say(place, error);
  }
}

for (const button of document.querySelectorAll("[data-part]")) {
  button.addEventListener("click", () => change(`/surveys/${button.dataset.part}`, "DELETE"));
}
for (const button of document.querySelectorAll("[data-join]")) {
  button.addEventListener("click", () => change(`/surveys/${button.dataset.join}`, "PUT", {}));
}
for (const input of document.querySelectorAll("input.station")) {
  input.addEventListener("change", () => {
    const station = Number.parseFloat(input.value.replace(",", "."));
    change(`/surveys/${input.dataset.survey}`, "PUT", Number.isFinite(station) ? { station_m: station } : {});
  });
}

const language = byId("language");
const imperial = byId("imperial");
function aim() {
  for (const link of document.querySelectorAll("[data-export]")) {
    const address = new URL(link.href);
    address.searchParams.set("language", language.value);
    if (imperial.checked) address.searchParams.set("imperial", "true");
    else address.searchParams.delete("imperial");
    link.href = address.href;
  }
}
language.addEventListener("change", aim);
imperial.addEventListener("change", aim);

function open(index) {
  edited = index;
  const one = observations[index] ?? { station: 0, code: "BDB", ch1: "", ch2: "", q1: null, clock_from: null, clock_to: null, continuous: "", remark: "" };
  for (const name of ["station", "code", "ch1", "ch2", "q1", "clock_from", "clock_to", "continuous", "remark"]) {
    fields[name].value = one[name] ?? "";
  }
  byId("remove").hidden = index < 0;
  byId("editor-failed").hidden = true;
  editor.showModal();
}
byId("add").addEventListener("click", () => open(-1));
for (const button of document.querySelectorAll("[data-edit]")) {
  button.addEventListener("click", () => open(Number(button.dataset.edit)));
}

function amount(name) {
  const text = fields[name].value.trim().replace(",", ".");
  return text === "" ? null : Number(text);
}

function keep(list) {
  change("/observations", "PUT", { observations: list }, byId("editor-failed"));
}

byId("editor-form").addEventListener("submit", (event) => {
  if (event.submitter?.value !== "save") return;
  event.preventDefault();
  const base = observations[edited] ?? {};
  const one = { ...base, station: amount("station"), code: fields.code.value, q1: amount("q1"), clock_from: amount("clock_from"), clock_to: amount("clock_to") };
  for (const name of ["ch1", "ch2", "continuous"]) one[name] = fields[name].value.trim().toUpperCase();
  one.remark = fields.remark.value.trim();
  const list = [...observations];
  if (edited < 0) list.push(one);
  else list[edited] = one;
  keep(list);
});
byId("remove").addEventListener("click", () => keep(observations.filter((_, index) => index !== edited)));
byId("undo-edit")?.addEventListener("click", () => change("/observations/undo", "POST"));
byId("delete").addEventListener("click", async () => {
  if (!confirm("Delete this report? Its surveys stay, and it can be restored.")) return;
  try {
    await ask(`/inspections/${number}`, { method: "DELETE" });
    location.assign(`/inspections?deleted=${number}`);
  } catch (error) {
    say(byId("failed"), error);
  }
});
wake();
