// The site: its plan, its manholes and pipes, lists read in.

import { BoxError, ask } from "./api.js";
import { byId, data, showFailure, wake } from "./dom.js";
import { NodeDialog } from "./node_dialog.js";
import { PipeDialog } from "./pipe_dialog.js";
import { startShell } from "./shell.js";
import { drawPlan } from "./site_plan.js";

startShell();
const { pipes, nodes } = data("pipes-data");
const again = () => location.assign("/site");
byId("plan-none").hidden = drawPlan(byId("plan"), nodes, pipes);

function confirm(title, text, action) {
  byId("delete-dialog-title").textContent = title;
  byId("delete-text").textContent = text;
  byId("delete-confirm").onclick = () => {
    byId("delete-dialog").close();
    action();
  };
  byId("delete-dialog").showModal();
}

const nodeDialog = new NodeDialog(confirm, again);
byId("node-new").addEventListener("click", () => nodeDialog.open(null));
for (const button of document.querySelectorAll("[data-node]")) {
  button.addEventListener("click", () => nodeDialog.open(nodes.find((node) => node.id === Number(button.dataset.node))));
}

const pipeDialog = new PipeDialog(nodes, again);
byId("pipe-new").addEventListener("click", () => pipeDialog.open(null));
for (const button of document.querySelectorAll("[data-edit-pipe]")) {
  button.addEventListener("click", () => pipeDialog.open(pipes.find((pipe) => pipe.id === Number(button.dataset.editPipe))));
}

async function does(what) {
  try {
    showFailure(byId("site-failed"), null);
    await what();
  } catch (error) {
    showFailure(byId("site-failed"), error.message);
  }
}

for (const button of document.querySelectorAll("[data-delete-pipe]")) {
  button.addEventListener("click", () => {
    const pipe = pipes.find((one) => one.id === Number(button.dataset.deletePipe));
    confirm(`Delete the pipe ${pipe.name}?`, "It leaves the list; its surveys and reports stay. You can undo this.", () =>
      does(async () => {
        await ask(`/pipes/${pipe.id}`, { method: "DELETE" });
        location.assign(`/site?deleted=${pipe.id}`);
      }),
    );
  });
}
for (const button of document.querySelectorAll("[data-restore-pipe]")) {
  button.addEventListener("click", () =>
    does(async () => {
      await ask(`/pipes/${button.dataset.restorePipe}/restore`, { method: "POST" });
      again();
    }),
  );
}

function readEpsg(text) {
  const typed = text.trim().replace(/^EPSG:/i, "");
  if (!typed) return null;
  if (!/^\d{4,5}$/.test(typed)) throw new BoxError("EPSG number: four or five digits, such as 25832, or nothing.");
  return Number(typed);
}

byId("site-form").addEventListener("submit", (event) => {
  event.preventDefault();
  const { name, crs } = event.target.elements;
  does(async () => {
    await ask("/site", { method: "PATCH", body: { name: name.value, crs: readEpsg(crs.value) } });
    again();
  });
});

byId("import").addEventListener("submit", async (event) => {
  event.preventDefault();
  const said = byId("import-said");
  const file = byId("i-file").files[0];
  said.textContent = "Reading the list …";
  try {
    const crs = readEpsg(byId("i-crs").value);
    const body = { text: await file.text(), file_name: file.name.slice(-80), ...(crs === null ? {} : { crs }) };
    const done = await ask("/pipes/import", { method: "POST", body, timeoutMs: 30000 });
    said.textContent = `${done.pipes} pipes and ${done.nodes} manholes added, ${done.there} pipes were there already. `;
    const link = document.createElement("a");
    link.href = "/site";
    link.textContent = "Show them";
    said.append(link);
  } catch (error) {
    said.textContent = error.message;
  }
});
wake();
