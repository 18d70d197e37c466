// Numbers as people type them.

import { BoxError } from "./api.js";

// A decimal comma is a point; nothing is null; a slip is NaN.
export function readNumber(text) {
  const plain = text.trim().replace(",", ".");
  if (!plain) return null;
  return /^[-+]?\d+(\.\d*)?$|^[-+]?\.\d+$/.test(plain) ? Number(plain) : NaN;
}

// The same, but a slip is told by the name of its field.
export function wantNumber(text, what) {
  const value = readNumber(text);
  if (Number.isNaN(value)) throw new BoxError(`${what}: ${text.trim()} is no number.`);
  return value;
}
