"""The anomaly surveys of an inspection: a sheet of each with its two pictures, and what they found, joined along the pipe."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import cv2
import numpy as np

from device.anomaly.along import PlacedScan, placed_scan
from device.anomaly.views import unpacked, wall_png
from device.inspections.model import AnomalySheet, Photo
from device.pictures import encode_jpeg
from device.store import Store


def deviations(
    store: Store, survey_id: int, station: float | None, pipe: str
) -> tuple[AnomalySheet, PlacedScan, list[Photo]] | None:
    """Of one survey; None where it has no result. ``station`` (m) as the inspection states it counts more than what was said
    at the scan; ``pipe`` begins the names of the photos. A scan that was refused tells nothing of the pipe."""
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
        picture=names[0] if overlay is not None else "",
        wall=names[-1] if kept is not None else "",
    )
    if sheet.verdict != "accept":
        return sheet, PlacedScan([], [], []), photos
    placed = placed_scan(survey_id, result, stands)
    for region in placed.regions:
        region |= {"height_mm": sheet.height_mm, "photo": sheet.picture}
    return sheet, placed, photos


def _height(result: Mapping[str, Any]) -> float | None:
    """The pipe's height: seen, or of the named profile that was fitted; None where neither can be believed."""
    if result.get("height_mm") is not None:
        return float(result["height_mm"])
    fitted = result.get("profile_height_mm")
    return None if fitted is None else float(fitted)
