// What the pages of single surveys share: deletion, and the point cloud when it is asked for.

import { ask } from "./api.js";
import { byId, html, showFailure } from "./dom.js";

export function startDeletion(id) {
  const confirm = byId("delete-confirm");
  byId("delete").addEventListener("click", () => byId("delete-dialog").showModal());
  confirm.addEventListener("click", async () => {
    confirm.disabled = true;
    try {
      await ask(`/surveys/${id}`, { method: "DELETE" });
      location.assign(`/surveys?deleted=${id}`);
    } catch (error) {
      showFailure(byId("delete-error"), error.message);
      confirm.disabled = false;
    }
  });
}

export async function openCloud(id) {
  const button = byId("cloud-show");
  const place = byId("cloud");
  button.disabled = true;
  place.hidden = false;
  place.replaceChildren(html("p", {}, "Loading the points …"));
  try {
    const { showCloud } = await import("./cloud.js");
    await showCloud(place, id);
    button.hidden = true;
    place.querySelector("canvas")?.focus();
  } catch (error) {
    place.replaceChildren(html("p", { class: "failed" }, error.message));
    button.disabled = false;
  }
}
