"""Everything as CSV and as JSON, for spreadsheets and programs of one's own."""

from __future__ import annotations

from dataclasses import asdict

from device.export.base import Options
from device.export.pacp import table
from device.inspections.codes import codes
from device.inspections.model import Inspection
from device.json_text import dumps

_OBSERVATION = (
    "number",
    "station_m",
    "code",
    "characterisation_1",
    "characterisation_2",
    "quantification_1",
    "quantification_2",
    "clock_from",
    "clock_to",
    "continuous",
    "at_joint",
    "text",
    "remark",
    "photo",
    "source",
    "mscc5",
    "pacp",
)
_LANDMARK = (
    "id",
    "class",
    "chainage_m",
    "chainage_to_m",
    "clock",
    "clock_to",
    "sigma_chainage_m",
    "sigma_chainage_to_m",
    "hits",
    "status",
    "decision",
)
_DIAMETER = (
    "survey",
    "verdict",
    "reasons",
    "diameter_mm",
    "interval_low_mm",
    "interval_high_mm",
    "minimum_mm",
    "maximum_mm",
    "ovality",
    "dn",
    "station",
    "position",
    "camera",
    "water_mm",
)
_DEVIATION = (
    "survey",
    "number",
    "kind",
    "chainage_m",
    "clock",
    "width_hours",
    "peak_mm",
    "area_mm2",
    "volume_cm3",
    "from_m",
    "to_m",
    "expected",
    "confidence",
    "seen_in",
    "seen_from",
)
_BAND = ("from_m", "to_m", "score_mm", "outward_mm", "measured", "sees_mm2", "surveys")


def csv_tables(inspection: Inspection, options: Options) -> dict[str, bytes]:
    """Observations, landmarks, diameters and deviations with their scores, a file each."""
    observations = []
    for one in inspection.observations:
        code = codes().get(one.code)
        values = (
            one.number,
            f"{one.station:.2f}",
            one.code,
            one.ch1,
            one.ch2,
            one.q1,
            one.q2,
            one.clock_from,
            one.clock_to,
            one.continuous,
            int(one.at_joint),
            "" if code is None else code.text(options.language),
            one.remark,
            one.photo,
            one.source,
            "" if code is None else code.mscc5,
            "" if code is None else code.pacp,
        )
        observations.append(dict(zip(_OBSERVATION, map(_cell, values), strict=True)))
    landmarks = [{name: _cell(one.get(name)) for name in _LANDMARK} for one in inspection.landmarks]
    diameters = []
    for sheet in inspection.diameters:
        low, high = sheet.interval_mm or (None, None)
        values_of = {**asdict(sheet), "reasons": " ".join(sheet.reasons), "interval_low_mm": low, "interval_high_mm": high}
        diameters.append({name: _cell(values_of[name]) for name in _DIAMETER})
    return {
        "observations.csv": table(_OBSERVATION, observations),
        "landmarks.csv": table(_LANDMARK, landmarks),
        "diameters.csv": table(_DIAMETER, diameters),
        "deviations.csv": table(
            _DEVIATION, [{name: _cell(one.get(name)) for name in _DEVIATION} for one in inspection.anomalies]
        ),
        "deviation_scores.csv": table(_BAND, [{name: _cell(band[name]) for name in _BAND} for band in inspection.bands]),
    }


def json_document(inspection: Inspection, options: Options) -> bytes:
    """The whole inspection but for its photos, which are named, and its points, which are counted."""
    document = asdict(inspection)
    document["photos"] = [photo.name for photo in inspection.photos]
    document["clouds"] = [{"survey": cloud.survey, "points": len(cloud.points)} for cloud in inspection.clouds]
    document["format"] = "borescout inspection 2"
    return (dumps(document) + "\n").encode()


def _cell(value: object) -> str:
    if isinstance(value, (list, tuple)):
        return " ".join(map(_cell, value))
    return "" if value is None else str(value)
