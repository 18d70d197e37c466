"""One ZIP for an inspection: every format, the photos named by object and number, and a manifest with a hash of each file."""

from __future__ import annotations

import hashlib
import io
import zipfile
from collections.abc import Callable, Mapping

from device.errors import Invalid
from device.export.base import Options
from device.inspections.model import Inspection
from device.json_text import dumps

MANIFEST = "manifest.json"
_MOMENT = (1980, 1, 1, 0, 0, 0)
"""The same content gives the same file: times of packing say nothing of the inspection."""
Parts = Mapping[str, Callable[[Inspection, Options], Mapping[str, bytes]]]


def archive(inspection: Inspection, options: Options, parts: Parts) -> bytes:
    """The ZIP. A format that this inspection cannot have (no coordinates, no date) is named in the manifest with the reason."""
    files: dict[str, bytes] = {}
    left_out: dict[str, str] = {}
    for name, part in parts.items():
        try:
            files.update(part(inspection, options))
        except Invalid as error:
            left_out[name] = str(error)
    files.update({f"photos/{photo.name}": photo.jpeg for photo in inspection.photos})
    manifest = {
        "inspection": inspection.number,
        "pipe": inspection.pipe.name,
        "program": options.program,
        "files": [
            {"name": name, "bytes": len(data), "sha256": hashlib.sha256(data).hexdigest()}
            for name, data in sorted(files.items())
        ],
        "left_out": left_out,
    }
    files[MANIFEST] = (dumps(manifest) + "\n").encode()
    whole = io.BytesIO()
    with zipfile.ZipFile(whole, "w") as packed:
        for name in sorted(files):
            info = zipfile.ZipInfo(name, _MOMENT)
            info.compress_type = zipfile.ZIP_STORED if name.endswith((".jpg", ".pdf")) else zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            packed.writestr(info, files[name])
    return whole.getvalue()
