"""The anomaly surveys of an inspection: a sheet of each, its regions along the pipe, and its two pictures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from device.anomaly.views import unpacked, wall_png
from device.inspections.model import AnomalySheet, Photo
from device.pictures import encode_jpeg
from device.store import Store

Region = Mapping[str, Any]


def deviations(
    store: Store, survey_id: int, station: float | None, pipe: str
) -> tuple[AnomalySheet, list[Region], list[Photo]] | None:
    """Of one survey; None where it has no result. ``station`` (m) as the inspection states it counts more than what was said
    at the scan; ``pipe`` begins the names of the photos."""
    stated = store.surveys.get(survey_id)
    result = stated["result"]
    if result is None:
        return None
    stands = station if station is not None else result["chainage_m"]
    photos = []
    overlay, kept = (store.surveys.anomaly_view(survey_id, what) for what in ("overlay", "map"))
    if overlay is not None:
        photos.append(Photo(f"{pipe}_{survey_id}_deviation.jpg", overlay))
    if kept is not None:
        wall = cv2.imdecode(np.frombuffer(wall_png(unpacked(kept)), np.uint8), cv2.IMREAD_COLOR)
        photos.append(Photo(f"{pipe}_{survey_id}_wall.jpg", encode_jpeg(np.asarray(wall, dtype=np.uint8))))
    names = [photo.name for photo in photos]
    sheet = AnomalySheet(
        survey=survey_id,
        verdict=stated["final_verdict"],
        reasons=tuple(result["reasons"]),
        station=stands,
        score_mm=result["score_mm"],
        outward_mm=result["outward_mm"],
        coverage=result["coverage"],
        near=result.get("near_m"),
        far=result.get("far_m"),
        unconfirmed=result.get("unconfirmed", 0),
        height_mm=_height(result),
        joints=tuple(_placed(joint, stands) for joint in result["joints"]),
        bands=tuple(_band(band, stands) for band in result["bands"]),
        picture=names[0] if overlay is not None else "",
        wall=names[-1] if kept is not None else "",
    )
    regions: list[Region] = [
        {**_placed(region, stands), "survey": survey_id, "number": number, "height_mm": sheet.height_mm, "photo": sheet.picture}
        for number, region in enumerate(result["regions"], 1)
    ]
    return sheet, regions if sheet.verdict == "accept" else [], photos


def _height(result: Mapping[str, Any]) -> float | None:
    """The pipe's height: seen, or of the named profile that was fitted; None where neither can be believed."""
    if result.get("height_mm") is not None:
        return float(result["height_mm"])
    fitted = result.get("profile_height_mm")
    return None if fitted is None else float(fitted)


def _placed(thing: Mapping[str, Any], station: float | None) -> dict[str, Any]:
    return {**thing, "chainage_m": None if station is None else round(station + thing["z_m"], 3)}


def _band(band: Mapping[str, Any], station: float | None) -> dict[str, Any]:
    along = {"from_m": band["first_m"], "to_m": band["last_m"]}
    return {
        **{key: None if station is None else round(station + value, 3) for key, value in along.items()},
        **{key: band[key] for key in ("score_mm", "outward_mm", "measured")},
    }
