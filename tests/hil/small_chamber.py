"""A chamber small enough to be mapped within seconds: three pipes, a tee and an elbow, seen from a short way before them."""

from __future__ import annotations

import json
from pathlib import Path


def small_chamber(folder: Path) -> Path:
    """Its structure file."""
    stated = {
        "name": "small chamber",
        "pipes": [
            {"from": [-0.6, 0, 4.6], "to": [0.6, 0, 4.6]},
            {"from": [0, 0, 4.6], "to": [0, 0, 3.8]},
            {"from": [0.6, 0, 4.6], "to": [0.6, 0, 3.9]},
        ],
        "objects": [
            {"class": "tee", "position": [0, 0, 4.6], "axis": [1, 0, 0], "branch": [0, 0, -1]},
            {"class": "elbow", "position": [0.6, 0, 4.6], "axis": [-1, 0, 0], "branch": [0, 0, -1]},
        ],
        "path": {"radius_m": [2.4, 2.6], "depth_m": [4.0, 4.1], "turns": 0.12, "duration_s": 60, "sway_deg": 0.5},
        "scanner": {"rate_hz": 1.0, "columns": 130, "rows": 110},
        "navigation": {"dvl_outages_s": [], "dvl_hz": 5, "pressure_hz": 4, "ahrs_hz": 10},
    }
    path = folder / "chamber.json"
    path.write_text(json.dumps(stated), encoding="utf-8")
    return path
