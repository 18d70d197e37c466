"""One input to a map, exchange files and a row of the summary. Runs in a worker process, here or on another machine."""

from __future__ import annotations

import contextlib
import io
import shutil
import time
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from device.batch.inputs import Input
from device.errors import DeviceError, Invalid
from device.export.base import Options
from device.export.formats import export
from device.inspections.coding import observations
from device.inspections.model import Inspection, NodeRecord, PipeRecord
from device.json_text import dumps
from device.landmarks.command import Options as MapOptions
from device.landmarks.command import map_source
from device.landmarks.picture import save_map_picture
from drivers.base import DriverError

Row = dict[str, Any]


@dataclass(frozen=True)
class Job:
    """``folder`` is where this input's files go; ``pipe`` what the pipe list says of it, None where it says nothing."""

    source: Input
    folder: Path
    pipe: PipeRecord | None
    crs: int | None
    program: str


def convert(job: Job) -> Row:
    """Convert one input; the row says how it went. Never raises for a bad file: that is what a row with an error is for."""
    began = time.monotonic()
    row: Row = {"input": job.source.name, "kind": job.source.kind, "ok": False, "error": None, "landmarks": None}
    try:
        with contextlib.redirect_stderr(io.StringIO()) as said:
            found = _map(job.source)
            row |= _write(job, found)
        row["ok"] = True
        row["notes"] = [line.removeprefix("borescout: ") for line in said.getvalue().splitlines() if line.strip()]
    except (DeviceError, DriverError) as error:
        row["error"] = str(error)
    except Exception as error:  # noqa: BLE001 - one file that trips a library over must not stop the others
        row["error"] = f"It could not be converted: {type(error).__name__}: {error}"
    row["seconds"] = round(time.monotonic() - began, 3)
    return row


def _map(source: Input) -> Row:
    """The map as ``borescout map --json`` states it, or what a recording's replay finds."""
    if source.kind == "recording":
        return _replayed(source.path)
    distances = source.path / "distance.csv" if source.kind == "stills" else source.path.with_suffix(".csv")
    if source.kind == "detections":
        options = MapOptions(detections=source.path, rig=source.path.with_suffix(".json"))
    else:
        csv, osd = (distances, None) if distances.is_file() else (None, "auto")
        video, stills = (source.path, None) if source.kind == "video" else (None, source.path)
        options = MapOptions(video=video, stills=stills, distance_csv=csv, osd=osd)
    return map_source(options)


def _replayed(path: Path) -> Row:
    from device.replay.survey import Options as ReplayOptions
    from device.replay.survey import replay

    outcome = replay(path, ReplayOptions(workers=1), lambda line: None)
    return {"landmarks": [], "frames": outcome.frames, "replayed": outcome.kind, **outcome.findings}


def _write(job: Job, found: Row) -> Row:
    """The files of one input, put in place in one go, and what the summary says of it."""
    part = job.folder.with_name(f".{job.folder.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    (part / "map.json").write_text(dumps(found) + "\n", encoding="utf-8")
    if found.get("to_m") is not None and "replayed" not in found:
        save_map_picture(part / "map.png", found)
    inspection = _inspection(job, found)
    packed, name, _ = export("zip", inspection, Options(program=job.program))
    (part / name.replace("_0", "")).write_bytes(packed)
    shutil.rmtree(job.folder, ignore_errors=True)
    part.replace(job.folder)
    return {
        "landmarks": len(found["landmarks"]),
        "frames": found.get("frames"),
        "from_m": found.get("from_m"),
        "to_m": found.get("to_m"),
        "diameter_mm": found.get("diameter_mm"),
        "verdict": found.get("verdict"),
    }


def _inspection(job: Job, found: Row) -> Inspection:
    """The input as an inspection: of the pipe that the list names after it, or of one that is called like it."""
    name = Path(job.source.name).stem
    pipe = job.pipe or PipeRecord(name[:30], NodeRecord("start"), NodeRecord("end"))
    span = found.get("to_m")
    if span is not None and span < 0:
        raise Invalid("Its distance runs below zero: the counter was not set at the start node.")
    recorded = datetime.fromtimestamp(job.source.path.stat().st_mtime, UTC)
    inspection = Inspection(
        number=0,
        site="archive",
        pipe=pipe,
        date=recorded.strftime("%Y-%m-%dT%H:%M:%SZ"),
        length=None if span is None else round(float(span), 2),
        crs=job.crs,
        note=f"converted from {job.source.name}",
        landmarks=tuple(one for one in found["landmarks"] if one.get("chainage_m", -1) >= 0),
    )
    return replace(inspection, observations=observations(inspection))
