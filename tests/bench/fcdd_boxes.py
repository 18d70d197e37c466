"""Figure 2 of the detector: does the peak of the deposit's heatmap lie where somebody drew a box round an obstacle or deposit?

    python -m tests.bench.fcdd_boxes [--model FILE] [--pictures DIR]

Beside it the best constant point: the one place of the picture that lies in most boxes, chosen knowing them all. The interval
is a 95 % bootstrap over pictures. ``--pictures`` writes the heatmap over each picture, hits and misses.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from device.fcdd.model import load_model
from tests.bench.real_data import data_folder

OBSTACLE = 1
GRID = 64


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.fcdd_boxes", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--model", type=Path)
    parser.add_argument("--label", default="deposit")
    parser.add_argument("--pictures", type=Path)
    chosen = parser.parse_args()
    network = load_model(chosen.model)
    hits, inside = [], []
    for file in sorted((data_folder().parent / "cctv_boxes").glob("*.png")):
        boxes = _boxes(file.with_suffix(".txt"))
        if not len(boxes):
            continue
        picture = np.asarray(cv2.imread(str(file)), np.uint8)
        heat = network.see(picture, mirrored=True).heatmap(chosen.label)
        fine = np.asarray(cv2.resize(heat, (352, 288), interpolation=cv2.INTER_CUBIC))
        y, x = np.unravel_index(int(np.argmax(fine)), fine.shape)
        hits.append(_holds(boxes, (x + 0.5) / 352, (y + 0.5) / 288))
        inside.append([[_holds(boxes, (i + 0.5) / GRID, (j + 0.5) / GRID) for i in range(GRID)] for j in range(GRID)])
        if chosen.pictures is not None:
            _draw(chosen.pictures / f"{'hit' if hits[-1] else 'miss'}_{file.stem}.png", picture, fine, boxes)
    found = np.array(hits)
    constant = np.mean(inside, axis=0)
    best = np.unravel_index(int(np.argmax(constant)), constant.shape)
    rng = np.random.default_rng(0)
    drawn = [found[rng.integers(0, len(found), len(found))].mean() for _ in range(2000)]
    low, high = np.percentile(drawn, [2.5, 97.5])
    print(f"{len(found)} pictures with a box: peak of {chosen.label} in a box {found.mean():.1%} ({low:.1%} to {high:.1%})")
    print(f"best constant point {constant.max():.1%}, at {best[1] / GRID:.2f}, {best[0] / GRID:.2f} of width and height")


def _boxes(file: Path) -> Any:
    rows = [[float(value) for value in line.split()] for line in file.read_text().splitlines() if line.strip()]
    return np.array([row[1:5] for row in rows if int(row[0]) == OBSTACLE])


def _holds(boxes: Any, x: float, y: float) -> bool:
    return bool(np.any((np.abs(boxes[:, 0] - x) <= boxes[:, 2] / 2) & (np.abs(boxes[:, 1] - y) <= boxes[:, 3] / 2)))


def _draw(file: Path, picture: Any, heat: Any, boxes: Any) -> None:
    file.parent.mkdir(parents=True, exist_ok=True)
    height, width = picture.shape[:2]
    level = np.clip(255 * cv2.resize(heat, (width, height)) / max(float(heat.max()), 1e-6), 0, 255).astype(np.uint8)
    shown = cv2.addWeighted(picture, 0.6, cv2.applyColorMap(level, cv2.COLORMAP_JET), 0.4, 0)
    for x, y, w, h in boxes:
        a, b = (
            (round((x - w / 2) * width), round((y - h / 2) * height)),
            (round((x + w / 2) * width), round((y + h / 2) * height)),
        )
        cv2.rectangle(shown, a, b, (255, 255, 255), 1)
    cv2.imwrite(str(file), shown)


if __name__ == "__main__":
    main()
