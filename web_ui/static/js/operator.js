// The operator's name, kept by the browser from one answer to the next.

const NAME_KEY = "borescout.operator";

export function remember(name) {
  try {
    localStorage.setItem(NAME_KEY, name);
  } catch {
    // Private windows may refuse storage; the name is then typed again.
  }
}

export function recall() {
  try {
    return localStorage.getItem(NAME_KEY) ?? "";
  } catch {
    return "";
  }
}
