"""A table of detections and the rig they were made with, from files that other programs wrote. Every slip is one sentence."""

from __future__ import annotations

import csv
import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from device.errors import Invalid
from drivers.picture_folder import is_number
from estimators.landmarks.from_detections import Rig, Rows

COLUMNS = ("frame", "time_s", "chainage_m", "u", "v", "class", "score")
CENTRE_COLUMNS = ("foe_u", "foe_v")
MOST_FRAMES = 10**12
LARGEST_RADIUS_M = 10.0
RIG_FIELDS = ("fx", "fy", "cx", "cy", "radius_m", "width", "height")


def read_detections(path: Path) -> Rows:
    """The rows of a CSV with ``COLUMNS`` and, where they are there, ``CENTRE_COLUMNS``. Raises Invalid."""
    text = _text(path, "detections")
    lines = csv.DictReader(text.splitlines(), strict=True)
    try:
        names = [(name or "").strip() for name in (lines.fieldnames or [])]
        lines.fieldnames = names
        _check_columns(path, names)
        table = [_row(path, lines.line_num, row, names) for row in lines if any((value or "").strip() for value in _plain(row))]
    except csv.Error as error:
        raise Invalid(f"The detections {path} are no CSV: {error}.") from None
    if not table:
        raise Invalid(
            f"The detections {path} have no row: there must be one for each frame, with empty u where nothing was seen."
        )
    column = {name: [row[name] for row in table] for name in table[0]}
    foe = np.array([column[name] for name in CENTRE_COLUMNS], dtype=np.float64).T if CENTRE_COLUMNS[0] in column else None
    numbers = {name: np.array(column[name], dtype=np.float64) for name in ("time_s", "chainage_m", "u", "v", "score")}
    return Rows(
        frame=np.array(column["frame"], dtype=np.int64),
        time_s=numbers["time_s"],
        chainage=numbers["chainage_m"],
        u=numbers["u"],
        v=numbers["v"],
        label=column["class"],
        score=numbers["score"],
        foe=foe,
    )


def read_rig(path: Path) -> Rig:
    """The rig of a JSON object with ``RIG_FIELDS``. Raises Invalid."""
    try:
        found = json.loads(_text(path, "rig"))
    except json.JSONDecodeError as error:
        raise Invalid(f"The rig {path} is no JSON: {error.msg} in line {error.lineno}.") from None
    if not isinstance(found, dict):
        raise Invalid(f"The rig {path} must be one JSON object with {', '.join(RIG_FIELDS)}.")
    missing = [name for name in RIG_FIELDS if name not in found]
    if missing:
        raise Invalid(f"The rig {path} lacks {_list(missing)}.")
    for name in RIG_FIELDS:
        value = found[name]
        good = is_number(value)
        if not good or (value <= 0 and name not in ("cx", "cy")):
            raise Invalid(
                f"The {name} of the rig {path} must be a {'' if name in ('cx', 'cy') else 'positive '}number, not {value!r}."
            )
    if found["radius_m"] > LARGEST_RADIUS_M:
        raise Invalid(f"The radius_m of the rig {path} is {found['radius_m']:g} m: no pipe is that wide, give it in metres.")
    return Rig(
        float(found["fx"]),
        float(found["fy"]),
        float(found["cx"]),
        float(found["cy"]),
        float(found["radius_m"]),
        round(found["width"]),
        round(found["height"]),
    )


def _text(path: Path, what: str) -> str:
    try:
        text = path.read_text(encoding="utf-8-sig")
    except FileNotFoundError:
        raise Invalid(f"There is no file {path} with the {what}.") from None
    except IsADirectoryError:
        raise Invalid(f"{path} is a folder; the {what} must be a file.") from None
    except UnicodeDecodeError:
        raise Invalid(f"The {what} {path} cannot be read as text.") from None
    except OSError as error:
        raise Invalid(f"The {what} {path} cannot be read: {error.strerror}.") from None
    if not text.strip():
        raise Invalid(f"The file {path} with the {what} is empty.")
    return text


def _check_columns(path: Path, names: list[str]) -> None:
    missing = [name for name in COLUMNS if name not in names]
    if missing:
        raise Invalid(f"The detections {path} lack the column {_list(missing)}; they have {_list(names)}.")
    if (CENTRE_COLUMNS[0] in names) != (CENTRE_COLUMNS[1] in names):
        raise Invalid(f"The detections {path} have one of the columns foe_u and foe_v; it takes both or none.")


def _row(path: Path, line: int, row: dict[str, Any], names: list[str]) -> dict[str, Any]:
    def number(name: str, needed: bool) -> float:
        text = (row.get(name) or "").strip()
        if not text and not needed:
            return math.nan
        try:
            value = float(text)
        except ValueError:
            value = math.inf
        if math.isinf(value) or (math.isnan(value) and needed):
            shown = f'"{text[:24]}", which is no number' if text else "empty"
            raise Invalid(f"The detections {path}, line {line}: {name} is {shown}.")
        return value

    seen = math.isfinite(number("u", False))
    found: dict[str, Any] = {
        "frame": number("frame", True),
        "time_s": number("time_s", True),
        "chainage_m": number("chainage_m", True),
        "u": number("u", False),
        "v": number("v", seen),
        "class": (row.get("class") or "").strip(),
        "score": number("score", False),
    }
    if found["frame"] != math.floor(found["frame"]):
        raise Invalid(f"The detections {path}, line {line}: frame {found['frame']:g} is no whole number.")
    if abs(found["frame"]) > MOST_FRAMES:
        raise Invalid(f"The detections {path}, line {line}: there is no frame {found['frame']:g}.")
    if seen and not found["class"]:
        raise Invalid(f"The detections {path}, line {line}: the detection has no class.")
    if CENTRE_COLUMNS[0] in names:
        found |= {name: number(name, False) for name in CENTRE_COLUMNS}
    return found


def _plain(row: dict[Any, Any]) -> list[str]:
    return [value for value in row.values() if isinstance(value, str)]


def _list(names: list[str]) -> str:
    named = [name for name in names if name]
    if not named:
        return "none"
    return named[0] if len(named) == 1 else f"{', '.join(named[:-1])} and {named[-1]}"
