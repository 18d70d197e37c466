// Asking the box. Every answer that is not one becomes a BoxError with a sentence for the operator.

export class BoxError extends Error {
  constructor(message, { code = "no_answer", status = 0, waitS = 0 } = {}) {
    super(message);
    this.code = code;
    this.status = status;
    this.waitS = waitS;
  }
}

const NO_ANSWER = "The box does not answer; check that this device is on its Wi-Fi.";

const csrf = document.querySelector('meta[name="csrf-token"]')?.content ?? "";

export async function ask(path, { method = "GET", body, timeoutMs = 8000 } = {}) {
  const options = { method, signal: timeout(timeoutMs), cache: "no-store" };
  if (method !== "GET") {
    options.headers = { "Content-Type": "application/json", "X-CSRF-Token": csrf };
    options.body = JSON.stringify(body ?? {});
  }
  let response;
  try {
    response = await fetch(`/api/v1${path}`, options);
  } catch {
    throw new BoxError(NO_ANSWER);
  }
  if (response.status === 204) return null;
  let answer;
  try {
    answer = await response.json();
  } catch {
    throw new BoxError(response.ok ? NO_ANSWER : `The box answered with error ${response.status}.`, { status: response.status });
  }
  if (response.status === 401) location.reload(); // sent away, or paired too long ago: the page to pair comes in place of this one
  if (!response.ok) {
    const waitS = Number(response.headers.get("Retry-After") ?? 0);
    throw new BoxError(answer?.error?.message ?? "The box refused.", { code: answer?.error?.code, status: response.status, waitS });
  }
  return answer;
}

// AbortSignal.timeout is missing in browsers that are still in the field (Safari before 16).
export function timeout(milliseconds) {
  const controller = new AbortController();
  setTimeout(() => controller.abort(), milliseconds);
  return controller.signal;
}
