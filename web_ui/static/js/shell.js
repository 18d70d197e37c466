// What every page does: health strip, the banner when the box is out of reach, the clock.

import { offerClock } from "./clock.js";
import { startControl } from "./control.js";
import { announce, byId, setText } from "./dom.js";
import { Feed } from "./events.js";
import { showHealth } from "./health.js";

function showNews(count) {
  byId("news").hidden = !count || location.pathname === "/alone";
  setText(byId("news-count"), count === 1 ? "One thing" : `${count} things`);
}

// On a phone the surveys are behind one button of the bar; a wide bar shows them all, and the button is gone.
function startMenu() {
  const menu = document.getElementById("surveys");
  if (!menu) return;
  const button = byId("surveys-open");
  const open = (wanted) => {
    menu.toggleAttribute("data-open", wanted);
    button.setAttribute("aria-expanded", String(wanted));
  };
  button.addEventListener("click", () => open(!menu.hasAttribute("data-open")));
  document.addEventListener("click", (event) => !menu.contains(event.target) && open(false));
  menu.addEventListener("focusout", (event) => event.relatedTarget && !menu.contains(event.relatedTarget) && open(false));
  menu.addEventListener("keydown", (event) => {
    if (event.key !== "Escape") return;
    open(false);
    button.focus();
  });
}

export function startShell({ live = null } = {}) {
  const feed = new Feed(live ? { live } : { live: null, pollMs: 2000 });
  let status = null;
  const show = () => showHealth(status, feed.link);
  feed.on("status", (value) => {
    status = value;
    show();
    showNews(value.autonomy?.news ?? 0);
  });
  feed.on("link", (link) => {
    byId("link-lost").hidden = link !== "lost";
    if (link === "up") announce("Connection to the box is back.");
    show();
  });
  byId("health").addEventListener("toggle", show);
  // A page kept in the browser's cache must not hold a stream.
  window.addEventListener("pagehide", () => feed.stop());
  window.addEventListener("pageshow", (event) => {
    if (event.persisted) feed.start();
  });
  startControl(feed);
  startMenu();
  feed.start();
  offerClock();
  return feed;
}
