// Numbers as people type them.

import { BoxError } from "./api.js";

// A decimal comma is a point; nothing is null; a slip is told by the name of its field.
export function readNumber(text, what) {
  const typed = text.trim().replace(",", ".");
  if (!typed) return null;
  const value = Number(typed);
  if (!Number.isFinite(value)) throw new BoxError(`${what}: ${text.trim()} is no number.`);
  return value;
}
