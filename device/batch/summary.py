"""One table of all inputs (Parquet), one of all landmarks (GeoParquet 1.1: points where the nodes have coordinates)."""

from __future__ import annotations

import json
import struct
from pathlib import Path
from typing import Any

from device.batch.convert import Job, Row
from device.errors import Invalid
from device.export.geojson import place_of

INPUTS, LANDMARKS = "inputs.parquet", "landmarks.parquet"
_GEO = {
    "version": "1.1.0",
    "primary_column": "geometry",
    "columns": {"geometry": {"encoding": "WKB", "geometry_types": ["Point"]}},
}


def write_summary(out: Path, jobs: list[Job], rows: list[Row]) -> None:
    """Both tables, replaced. Raises Invalid without the package pyarrow."""
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        raise Invalid("The summary needs the package pyarrow: pip install 'borescout[batch]'.") from None
    inputs = pa.schema(
        [
            ("input", pa.string()),
            ("kind", pa.string()),
            ("ok", pa.bool_()),
            ("error", pa.string()),
            ("landmarks", pa.int64()),
            ("frames", pa.int64()),
            ("from_m", pa.float64()),
            ("to_m", pa.float64()),
            ("diameter_mm", pa.float64()),
            ("verdict", pa.string()),
            ("seconds", pa.float64()),
        ]
    )
    landmarks = pa.schema(
        [
            ("input", pa.string()),
            ("class", pa.string()),
            ("chainage_m", pa.float64()),
            ("chainage_to_m", pa.float64()),
            ("clock", pa.float64()),
            ("clock_to", pa.float64()),
            ("sigma_chainage_m", pa.float64()),
            ("sigma_chainage_to_m", pa.float64()),
            ("hits", pa.int64()),
            ("geometry", pa.binary()),
        ],
        metadata={"geo": json.dumps(_GEO)},
    )
    by_name = {job.source.name: job for job in jobs}
    ordered = sorted(rows, key=lambda row: str(row["input"]))
    _write(parquet, pa.Table.from_pylist([_only(row, inputs.names) for row in ordered], schema=inputs), out / INPUTS)
    found = [one for row in ordered if row["ok"] for one in _landmarks(by_name[row["input"]])]
    _write(parquet, pa.Table.from_pylist([_only(one, landmarks.names) for one in found], schema=landmarks), out / LANDMARKS)


def _landmarks(job: Job) -> list[Row]:
    stated = json.loads((job.folder / "map.json").read_text(encoding="utf-8"))
    return [{**one, "input": job.source.name, "geometry": _point(job, float(one["chainage_m"]))} for one in stated["landmarks"]]


def _point(job: Job, station: float) -> bytes | None:
    """WKB of a place in longitude and latitude, None where the nodes are nowhere."""
    if job.pipe is None or not (job.pipe.upstream.placed and job.pipe.downstream.placed) or not job.pipe.length:
        return None
    start, end = (place_of(node, job.crs) for node in (job.pipe.upstream, job.pipe.downstream))
    share = min(max(station / job.pipe.length, 0.0), 1.0)
    x, y = (a + share * (b - a) for a, b in zip(start, end, strict=True))
    return struct.pack("<BIdd", 1, 1, x, y)


def _only(row: Row, names: list[str]) -> Row:
    return {name: row.get(name) for name in names}


def _write(parquet: Any, table: Any, file: Path) -> None:
    part = file.with_name(f".{file.name}.part")
    parquet.write_table(table, part)
    part.replace(file)
