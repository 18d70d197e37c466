// One picture of the box, fetched again and again into a canvas. Each fetch waits for the last one, so a slow link only slows it down.

import { timeout } from "./api.js";

const REST_MS = { depth: 140, color: 280, drive: 120, stereo: 400 };
const AFTER_FAILURE_MS = 700;

export class PicturePoller {
  // wanted() tells whether anybody looks; onPicture() is called after each new picture, onNone() when the box has none.
  // address() is where the next picture is to be had, where that is not what the kind says.
  constructor(canvas, kind, { wanted, onPicture, onNone, address = () => `/api/v1/picture/${kind}.jpg?` }) {
    Object.assign(this, { canvas, kind, wanted, onPicture, onNone, address });
    this.number = 0;
  }

  async run() {
    for (;;) {
      let rest = REST_MS[this.kind];
      if (!document.hidden && this.wanted()) {
        try {
          if (await this.fetchOne()) this.onPicture();
          else this.onNone();
        } catch {
          rest = AFTER_FAILURE_MS; // out of reach; the view marks itself stale by its own clock
        }
      }
      await new Promise((resolve) => setTimeout(resolve, rest));
    }
  }

  async fetchOne() {
    this.number += 1;
    const response = await fetch(`${this.address()}n=${this.number}`, { cache: "no-store", signal: timeout(4000) });
    if (response.status === 204) return false;
    if (!response.ok) throw new Error(`picture: ${response.status}`);
    const bitmap = await createImageBitmap(await response.blob());
    if (this.canvas.width !== bitmap.width || this.canvas.height !== bitmap.height) {
      this.canvas.width = bitmap.width;
      this.canvas.height = bitmap.height;
    }
    this.canvas.getContext("2d").drawImage(bitmap, 0, 0);
    bitmap.close();
    return true;
  }
}

const STALE_S = 2;

// What a view is: "waiting" (nothing yet), "live", "stale" or "lost", and what to write over it.
export function viewState({ link, camera, ageS, pictureAgeS, age }) {
  if (link === "lost") return { state: "lost", text: `No link to the box. Picture is ${age(pictureAgeS)} old.` };
  if (camera === "lost") return { state: "lost", text: ageS === null ? "Camera lost." : `Camera lost. Last good frame ${age(ageS)} ago.` };
  if (pictureAgeS === null) return { state: "waiting", text: camera === "starting" ? "The camera is starting …" : "Waiting for the first picture …" };
  const oldest = Math.max(ageS ?? 0, pictureAgeS);
  if (oldest > STALE_S) return { state: "stale", text: `Old picture: ${age(oldest)}` };
  return { state: "live", text: "" };
}
