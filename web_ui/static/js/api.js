// Asking the box. Every answer that is not one becomes a BoxError with a sentence for the operator.

export class BoxError extends Error {
  constructor(message, { code = "no_answer", status = 0 } = {}) {
    super(message);
    this.code = code;
    this.status = status;
  }
}

const NO_ANSWER = "The box does not answer; check that this device is on its Wi-Fi.";

export async function ask(path, { method = "GET", body, timeoutMs = 8000 } = {}) {
  const options = { method, signal: timeout(timeoutMs), cache: "no-store" };
  if (method !== "GET") {
    options.headers = { "Content-Type": "application/json" };
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
  if (!response.ok) throw new BoxError(answer?.error?.message ?? "The box refused.", { code: answer?.error?.code, status: response.status });
  return answer;
}

// AbortSignal.timeout is missing in browsers that are still in the field (Safari before 16).
export function timeout(milliseconds) {
  const controller = new AbortController();
  setTimeout(() => controller.abort(), milliseconds);
  return controller.signal;
}
