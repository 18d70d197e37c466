"""A small archive of inspections: tables of detections with their rigs, and files that are broken in different ways."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np

from drivers.virtual.detections import ideal
from drivers.virtual.drive import Drive, Go
from drivers.virtual.furnish import furnished_sewer

FPS = 2.0
BROKEN = ("bad0.mp4", "bad1.csv", "bad2.mcap", "bad3.avi", "bad4.csv")


def make_archive(folder: Path, good: int, bad: int, length: float = 5.0) -> list[str]:
    """``good`` inputs of a pipe of ``length`` (m) each and ``bad`` broken ones (5 at most); their names."""
    folder.mkdir(parents=True)
    names = []
    for number in range(good):
        drive = Drive(furnished_sewer(np.random.default_rng(number), length, 0.3), (Go(length - 1.5, 0.5),), seed=number)
        names.append(f"run{number:02d}.csv")
        _write(folder / names[-1], drive)
    for name in BROKEN[:bad]:
        (folder / name).write_bytes(b"frame,time_s\n1,2\n" if name.endswith(".csv") else b"this is no video\n" * 9)
        if name.endswith(".csv"):
            (folder / name).with_suffix(".json").write_text("{}")
        names.append(name)
    return names


def _write(file: Path, drive: Drive) -> None:
    camera = drive.camera
    rig = {"fx": camera.fx, "fy": camera.fy, "cx": camera.cx, "cy": camera.cy, "radius_m": drive.sewer.radius}
    file.with_suffix(".json").write_text(json.dumps({**rig, "width": camera.width, "height": camera.height}))
    with file.open("w", newline="") as stream:
        rows = csv.writer(stream)
        rows.writerow(("frame", "time_s", "chainage_m", "u", "v", "class", "score", "foe_u", "foe_v"))
        for frame in range(int(drive.length_s * FPS)):
            t = frame / FPS
            centre = [round(value, 3) for value in drive.truth.focus_of_expansion(t)]
            where = (frame, round(t, 4), round(float(drive.position(t)), 4))
            seen = ideal(drive, t)
            for one in seen:
                rows.writerow((*where, round(one.u, 3), round(one.v, 3), one.label, 0.9, *centre))
            if not seen:
                rows.writerow((*where, "", "", "", "", *centre))
