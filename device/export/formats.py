"""The formats by name: which files each gives. Modules are loaded when asked for, since some bring much along."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from typing import Any

from device.export.archive import Parts, archive
from device.export.base import Options
from device.inspections.model import Inspection


@dataclass(frozen=True)
class Format:
    """``module`` and ``function`` that write it; ``file`` the name of its one file, None where it gives several."""

    module: str
    function: str
    file: str | None
    mime: str


FORMATS: dict[str, Format] = {
    "isybau": Format("device.export.isybau", "isybau", "isybau.xml", "application/xml"),
    "en13508": Format("device.export.en13508", "en13508", "en13508.txt", "text/plain; charset=iso-8859-1"),
    "pacp": Format("device.export.pacp", "pacp", None, "application/zip"),
    "geojson": Format("device.export.geojson", "geojson", "inspection.geojson", "application/geo+json"),
    "csv": Format("device.export.tables", "csv_tables", None, "application/zip"),
    "json": Format("device.export.tables", "json_document", "inspection.json", "application/json"),
    "ply": Format("device.export.ply", "ply", "pipe.ply", "application/octet-stream"),
    "gltf": Format("device.export.gltf", "gltf", "pipe.glb", "model/gltf-binary"),
    "chambers": Format("device.export.chambers", "chambers", None, "application/zip"),
    "pdf": Format("device.export.pdf", "pdf", "report.pdf", "application/pdf"),
}
NAMES = (*FORMATS, "zip")


def export(name: str, inspection: Inspection, options: Options) -> tuple[bytes, str, str]:
    """(data, file name, MIME type) of an inspection in the format ``name``. Several files come as one ZIP. Raises Invalid."""
    if name == "zip":
        parts: Parts = {part: partial(files, part) for part in FORMATS}
        return archive(inspection, options, parts), f"inspection_{inspection.number}.zip", "application/zip"
    found = files(name, inspection, options)
    about = FORMATS[name]
    if about.file is not None:
        return found[about.file], about.file, about.mime
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w", zipfile.ZIP_DEFLATED) as packed:
        for file, data in sorted(found.items()):
            packed.writestr(file, data)
    return whole.getvalue(), f"{name}_{inspection.number}.zip", about.mime


def files(name: str, inspection: Inspection, options: Options) -> Mapping[str, bytes]:
    """The files of one format by name. Raises Invalid."""
    about = FORMATS[name]
    written: Any = getattr(import_module(about.module), about.function)(inspection, options)
    return written if about.file is None else {about.file: written}
