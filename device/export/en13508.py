"""The text format of EN 13508-2: header, basic data (#B01 ...) and observations (#C) of one inspection.

Field letters and their order follow the published reader and example of the package kwb.en13508.2 (KWB Berlin, MIT):
``inst/extdata/eucodes.csv`` and ``example_13508_2.txt``; the norm itself was not at hand, so no conformity is claimed beyond
that. ``read`` is the way back, for files of ours and of others.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import Any

from device.errors import Invalid
from device.export.base import Options, day, fitting, printable
from device.inspections.model import Inspection, Observation

ENCODING = "ISO-8859-1"
_STANDARD = "EN 13508-2:2003+A1:2011"
_MATERIAL = {
    "PVC": "AX",
    "concrete": "AG",
    "clay": "AE",
    "PE": "AV",
    "PP": "AW",
    "GRP": "AL",
    "ductile iron": "AO",
    "unknown": "AZ",
}
_SHAPE = {"circular": "A", "egg": "C", "oval": "Z", "other": "Z"}
_COLUMNS = ("I", "A", "B", "C", "D", "E", "G", "H", "J", "K", "M", "F")


@dataclass(frozen=True)
class Block:
    """One inspection of a file: basic data by field code, observations as column code to text."""

    basics: dict[str, str]
    observations: tuple[dict[str, str], ...]


def en13508(inspection: Inspection, options: Options) -> bytes:
    """The file, in ISO-8859-1; other letters are replaced. Raises Invalid for what cannot be stated."""
    pipe = inspection.pipe
    basics = {
        "AAA": fitting(pipe.name, 30, "The name of the pipe"),
        "AAB": inspection.start.name,
        "AAD": pipe.upstream.name,
        "AAF": pipe.downstream.name,
        "AAK": "A" if inspection.direction == "downstream" else "B",
        "ABA": _STANDARD,
        "ABC": "A",
        "ABF": day(inspection, options).isoformat(),
        "ABH": inspection.operator,
        "ABQ": "" if pipe.length is None else _number(pipe.length),
        "ACA": _SHAPE.get(pipe.shape, "Z"),
        "ACB": "" if pipe.dn_mm is None else str(pipe.dn_mm),
        "ACC": "" if pipe.dn_mm is None or pipe.shape != "circular" else str(pipe.dn_mm),
        "ACD": _MATERIAL.get(pipe.material, "AZ"),
    }
    if inspection.date and len(inspection.date) > 10:
        basics["ABG"] = inspection.date[11:16]
    lines = [f"#A1={ENCODING}", f"#A2={options.language}", "#A3=;", "#A4=.", '#A5="', "#A6=2010"]
    for number, first in enumerate(("AA", "AB", "AC"), 1):
        named = [code for code in basics if code.startswith(first)]
        lines += [f"#B{number:02d}={';'.join(named)}", _row([basics[code] for code in named])]
    lines.append(f"#C={';'.join(_COLUMNS)}")
    lines += [_row([_cells(one)[column] for column in _COLUMNS]) for one in inspection.observations]
    return ("\r\n".join([*lines, "#Z"]) + "\r\n").encode(ENCODING, "replace")


def read(data: bytes) -> list[Block]:
    """The inspections of a file in this format. Raises Invalid where it is none."""
    lines = data.decode(ENCODING).splitlines()
    header = dict(line[1:].split("=", 1) for line in lines if line.startswith("#A") and "=" in line)
    if "A3" not in header:
        raise Invalid("This is no EN 13508-2 text: the line #A3= with its field separator is missing.")
    separator, quote = header["A3"], header.get("A5", '"')

    def cells(line: str) -> list[str]:
        return next(csv.reader([line], delimiter=separator, quotechar=quote), [])

    blocks: list[Block] = []
    basics: dict[str, str] = {}
    observations: list[dict[str, str]] = []
    names: list[str] = []
    in_observations = False
    for line in lines:
        if line.startswith("#A"):
            continue
        if line.startswith("#Z"):
            blocks.append(Block(basics, tuple(observations)))
            basics, observations, names, in_observations = {}, [], [], False
        elif line.startswith("#"):
            names = line.split("=", 1)[1].split(separator)
            in_observations = line.startswith("#C")
        elif line and in_observations:
            observations.append(dict(zip(names, cells(line), strict=False)))
        elif line:
            basics.update(zip(names, cells(line), strict=False))
    if basics or observations:  # the last block may lack its #Z
        blocks.append(Block(basics, tuple(observations)))
    return blocks


def observations_of(block: Block) -> tuple[Observation, ...]:
    """A block's observations as ours. Raises Invalid for numbers that are none."""
    return tuple(_observation(number, cells) for number, cells in enumerate(block.observations, 1))


def _observation(number: int, cells: dict[str, str]) -> Observation:
    try:
        return Observation(
            station=float(cells["I"]),
            code=cells["A"],
            ch1=cells.get("B", ""),
            ch2=cells.get("C", ""),
            q1=float(cells["D"]) if _is_number(cells.get("D")) else None,
            q2=float(cells["E"]) if _is_number(cells.get("E")) else None,
            clock_from=int(cells["G"]) if cells.get("G") else None,
            clock_to=int(cells["H"]) if cells.get("H") else None,
            continuous=cells.get("J", ""),
            at_joint=cells.get("K", "") == "A",
            remark=cells.get("F", ""),
            photo=cells.get("M", ""),
            number=number,
        )
    except (KeyError, ValueError) as error:
        raise Invalid(f"Observation {number} of the file cannot be read: {error}.") from None


def _cells(one: Observation) -> dict[str, str]:
    return {
        "I": _number(one.station),
        "A": one.code,
        "B": one.ch1,
        "C": one.ch2,
        "D": "" if one.q1 is None else _number(one.q1),
        "E": "" if one.q2 is None else _number(one.q2),
        "G": "" if one.clock_from is None else str(one.clock_from),
        "H": "" if one.clock_to is None else str(one.clock_to),
        "J": one.continuous,
        "K": "A" if one.at_joint else "",
        "M": one.photo,
        "F": printable(one.remark),
    }


def _row(values: list[Any]) -> str:
    text = io.StringIO()
    csv.writer(text, delimiter=";", lineterminator="").writerow([printable(str(value)) for value in values])
    return text.getvalue()


def _number(value: float) -> str:
    return f"{value:.2f}".rstrip("0").rstrip(".")


def _is_number(text: str | None) -> bool:
    try:
        return bool(text) and float(text or "") == float(text or "")
    except ValueError:
        return False
