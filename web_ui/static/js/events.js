// Live values from the box: Server-Sent Events where they work, polling where they do not (iOS drops streams of sleeping tabs).
// Listeners get "status", "live", "measurement", "prompt", "drive", "structure", "control", and "link" with "up" or "lost".

import { ask } from "./api.js";

const SILENCE_MS = 4000; // the box speaks at least once a second
const LOST_MS = 3500;
const POLL_MS = 400;
const RETRY_MS = 6000;
const NAMES = ["status", "live", "measurement", "prompt", "drive", "structure", "anomaly", "control"];

const tabName = () => Array.from(crypto.getRandomValues(new Uint32Array(2)), (part) => part.toString(36)).join("-");

export class Feed {
  // `live` names what is asked for beside the status where there is no stream: "live" or "drive"; null opens no stream at all.
  constructor({ live = "live", pollMs = POLL_MS } = {}) {
    this.live = live;
    this.pollMs = pollMs;
    this.listeners = new Map();
    this.tab = tabName();
    this.source = null;
    this.link = "up";
    this.heard = performance.now();
    this.polls = 0;
    this.stopped = true;
  }

  on(name, listener) {
    this.listeners.set(name, [...(this.listeners.get(name) ?? []), listener]);
  }

  emit(name, value) {
    for (const listener of this.listeners.get(name) ?? []) listener(value);
  }

  start() {
    if (!this.stopped) return;
    this.stopped = false;
    this.heard = performance.now();
    this.watch = setInterval(() => this.check(), 500);
    if (this.live && "EventSource" in window) this.open();
    else this.poll();
  }

  stop() {
    this.stopped = true;
    clearInterval(this.watch);
    clearTimeout(this.retry);
    this.close();
  }

  close() {
    this.source?.close();
    this.source = null;
  }

  open() {
    this.close();
    if (this.stopped) return;
    const source = new EventSource(`/api/v1/events?tab=${this.tab}`);
    this.source = source;
    this.opened = performance.now();
    for (const name of NAMES) {
      source.addEventListener(name, (event) => {
        if (this.source !== source) return;
        const begins = !this.streaming;
        this.streaming = true;
        this.hear();
        if (begins) this.emit("stream");
        this.emit(name, JSON.parse(event.data));
      });
    }
    source.onerror = () => {
      if (this.source === source) this.fallBack();
    };
  }

  fallBack() {
    this.close();
    this.streaming = false;
    this.poll();
    clearTimeout(this.retry);
    this.retry = setTimeout(() => this.open(), RETRY_MS);
  }

  check() {
    const now = performance.now();
    if (this.source && now - Math.max(this.heard, this.opened) > SILENCE_MS) this.fallBack();
    if (now - this.heard > LOST_MS) this.setLink("lost");
  }

  hear() {
    this.heard = performance.now();
    this.setLink("up");
  }

  setLink(link) {
    if (this.link === link) return;
    this.link = link;
    this.emit("link", link);
  }

  async poll() {
    if (this.polling) return;
    this.polling = true;
    while (!this.stopped && !this.streaming) {
      if (!document.hidden) {
        try {
          const wantStatus = this.polls % 3 === 0 || !this.live;
          this.polls += 1;
          const [status, control, live] = await Promise.all([
            wantStatus ? ask("/status", { timeoutMs: 3000 }) : null,
            wantStatus ? ask("/session", { timeoutMs: 3000 }) : null,
            this.live ? ask(`/${this.live}`, { timeoutMs: 3000 }) : null,
          ]);
          this.hear();
          if (status) this.emit("status", status);
          if (control?.paired) this.emit("control", control);
          if (this.live) this.emit(this.live, live);
        } catch {
          // Not an accident but the message: `check` turns the silence into the banner.
        }
      }
      await new Promise((resolve) => setTimeout(resolve, this.pollMs));
    }
    this.polling = false;
  }
}
