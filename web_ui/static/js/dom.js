// Small helpers around the document.

const SVG = "http://www.w3.org/2000/svg";

export const byId = (id) => document.getElementById(id);

export function svg(tag, attributes = {}, children = []) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...[children].flat());
  return element;
}

export function html(tag, attributes = {}, children = []) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, value);
  element.append(...[children].flat());
  return element;
}

export const icon = (name) =>
  svg("svg", { class: "icon", "aria-hidden": "true", focusable: "false" }, [svg("use", { href: `#icon-${name}` })]);

export function setIcon(parent, name) {
  const use = parent.querySelector("use");
  const href = `#icon-${name}`;
  if (use.getAttribute("href") !== href) use.setAttribute("href", href);
}

// Writing only what changed keeps screen readers quiet and the layout still.
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

export function setData(element, name, value) {
  if (element.dataset[name] !== value) element.dataset[name] = value;
}

export const announce = (text) => setText(byId("announce"), text);

export function showFailure(element, message) {
  element.hidden = !message;
  setText(element, message ?? "");
}

export function toast(text) {
  const place = byId("toast");
  place.textContent = text;
  place.hidden = false;
  setTimeout(() => (place.hidden = true), 4000);
}

// Buttons that would do nothing before their module runs are served disabled; a tap on a slow link is then seen to wait.
export function wake() {
  for (const element of document.querySelectorAll("[data-waits]")) element.disabled = false;
}

export const data = (id) => JSON.parse(byId(id).textContent);

// The server writes UTC; the reader wants the hour on the own wrist.
export function localTimes(root = document) {
  const format = new Intl.DateTimeFormat("en-GB", { dateStyle: "medium", timeStyle: "short" });
  for (const time of root.querySelectorAll("time[datetime]")) {
    const date = new Date(time.dateTime);
    if (!Number.isNaN(date.getTime())) time.textContent = format.format(date);
  }
}
