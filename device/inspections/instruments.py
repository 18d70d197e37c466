"""With what each survey of an inspection was made, and how that was calibrated."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from device.diameter.verdict import shipped
from device.inspections.model import Instrument

Facts = Mapping[str, Any]


def depth_camera(survey: int, result: Facts) -> Instrument:
    """Of a diameter: its interval includes the camera's scale error."""
    return Instrument(
        survey, "diameter", str(result.get("camera") or ""), {"scale_error": f"{100 * shipped()[1].scale_std:.1f} %"}
    )


def crawler(survey: int, drive: Facts) -> Instrument:
    """Of a drive: how its tether counts, how its camera looks, and what the drive itself found of both."""
    settings = drive["settings"]
    encoder = settings.get("encoder") or {}
    names = [name for name in (settings.get("grabber"), encoder.get("name")) if name]
    stated = {
        "counts_per_metre": encoder.get("counts_per_metre"),
        "focal": None if not settings.get("focal_px") else " x ".join(f"{value:.1f} px" for value in settings["focal_px"]),
        "scale_found": _with_sigma(drive.get("scale"), 4, ""),
        "focal_radius_found": _with_sigma(drive.get("focal_radius"), 1, " px m"),
    }
    return Instrument(survey, "landmarks", ", ".join(names), {name: str(value) for name, value in stated.items() if value})


def stereo_camera(survey: int, result: Facts) -> Instrument:
    """Of a scan: the constant error of its disparities, stated or found from the wall itself."""
    offset, std = result.get("offset_px"), result.get("offset_std_px")
    if offset is None:
        return Instrument(survey, "anomaly", str(result.get("camera") or ""))
    name = "offset_found" if result.get("own_offset") else "offset"
    stated = f"{offset:.2f} px" if std is None else f"{offset:.2f} ± {std:.2f} px"
    return Instrument(survey, "anomaly", str(result.get("camera") or ""), {name: stated})


def scanner(survey: int, found: Facts) -> Instrument:
    """Of a chamber."""
    settings = found["settings"]
    radius = settings.get("radius_m")
    return Instrument(
        survey,
        "structure",
        str(settings.get("scanner") or ""),
        {} if radius is None else {"pipe_radius": f"{1000 * radius:.1f} mm"},
    )


def _with_sigma(known: Facts | None, digits: int, unit: str) -> str | None:
    return None if not known else f"{known['value']:.{digits}f} ± {known['sigma']:.{digits}f}{unit}"
