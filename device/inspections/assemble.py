"""An inspection out of the store: its surveys' findings, their pictures, and what people edited, as one ``Inspection``."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

from pydantic import TypeAdapter, ValidationError

from device.anomaly.along import PlacedScan, joined
from device.config import sentence
from device.errors import Invalid
from device.inspections import instruments
from device.inspections.coding import numbered, observations
from device.inspections.deviations import deviations
from device.inspections.model import (
    AnomalySheet,
    Cloud,
    DiameterSheet,
    Inspection,
    Instrument,
    NodeRecord,
    Observation,
    Photo,
    PipeRecord,
)
from device.store import Store

_OBSERVATIONS = TypeAdapter(list[Observation])


def assemble(store: Store, number: int) -> Inspection:
    """Everything of one inspection. Raises NotFound, and Invalid where its pipe has no nodes."""
    kept = store.inspections.get(number)
    site, pipe = store.places.site(), _pipe(store, kept["pipe_id"])
    diameters: list[DiameterSheet] = []
    landmarks: list[Mapping[str, Any]] = []
    photos = [Photo(name, jpeg) for name, jpeg in store.inspections.photos(number).items()]
    clouds: list[Cloud] = []
    structures: list[Mapping[str, Any]] = []
    scans: list[AnomalySheet] = []
    placed: list[PlacedScan] = []
    made_with: list[Instrument] = []
    for survey in kept["surveys"]:
        survey_id = survey["survey_id"]
        if survey["kind"] == "landmarks":
            found, pictures = _drive(store, survey_id, pipe.name)
            landmarks += found
            photos += pictures
            made_with.append(instruments.crawler(survey_id, store.drives.map(survey_id)))
        elif survey["kind"] == "diameter":
            stated = store.surveys.get(survey_id)
            if stated["result"] is not None:
                diameters.append(_sheet(survey_id, stated["result"], stated["final_verdict"], survey["station_m"]))
                made_with.append(instruments.depth_camera(survey_id, stated["result"]))
            cloud = store.surveys.cloud(survey_id)
            if cloud is not None:
                clouds.append(_cloud(survey_id, cloud, survey["station_m"]))
        elif survey["kind"] == "anomaly":
            scanned = deviations(store, survey_id, survey["station_m"], _file_name(pipe.name))
            if scanned is not None:
                scans.append(scanned[0])
                placed.append(scanned[1])
                photos += scanned[2]
                made_with.append(instruments.stereo_camera(survey_id, store.surveys.get(survey_id)["result"]))
        elif survey["kind"] == "structure":
            structures.append(store.structures.map(survey_id))
            made_with.append(instruments.scanner(survey_id, structures[-1]))
    along = joined(placed)
    inspection = Inspection(
        number=number,
        site=site["name"],
        crs=site["crs"],
        pipe=pipe,
        operator=kept["operator"],
        date=kept["date"] or kept["created"],
        direction=kept["direction"],
        method=kept["method"],
        length=kept["length_m"],
        note=kept["note"],
        photos=tuple(photos),
        diameters=tuple(diameters),
        clouds=tuple(clouds),
        landmarks=tuple(landmarks),
        anomalies=tuple(along["regions"]),
        joints=tuple(along["joints"]),
        bands=tuple(along["bands"]),
        scans=tuple(scans),
        structures=tuple(structures),
        instruments=tuple(made_with),
    )
    edited = store.inspections.observations(number)
    coded = observations(inspection) if edited is None else read_observations(edited)
    return replace(inspection, observations=coded)


def read_observations(stated: Sequence[Mapping[str, Any]]) -> tuple[Observation, ...]:
    """Observations as they come in over HTTP or out of the store, numbered anew. Raises Invalid."""
    try:
        return numbered(_OBSERVATIONS.validate_python(list(stated)))
    except ValidationError as error:
        raise Invalid(sentence(error, "observation")) from None


def observation_json(one: Observation) -> dict[str, Any]:
    """As ``read_observations`` takes it back."""
    return asdict(one)


def _pipe(store: Store, pipe_id: int) -> PipeRecord:
    pipe = store.places.pipe(pipe_id, deleted=True)  # its reports stay
    nodes = {node["id"]: node for node in store.places.nodes()}
    ends = [nodes.get(pipe[key]) for key in ("start_node", "end_node")]
    if None in ends:
        raise Invalid(f"The pipe {pipe['name']} lacks a node at one end: choose both, then an inspection can go out.")
    upstream, downstream = (
        NodeRecord(node["name"], node["easting"], node["northing"], node["level"]) for node in ends if node is not None
    )
    return PipeRecord(
        pipe["name"], upstream, downstream, pipe["material"], pipe["shape"], pipe["reference_dn"], pipe["length_m"]
    )


def _drive(store: Store, survey_id: int, pipe: str) -> tuple[list[Mapping[str, Any]], list[Photo]]:
    """Landmarks of a drive with the names of their photos, and the photos."""
    landmarks: list[Mapping[str, Any]] = []
    photos = []
    for one in store.drives.map(survey_id)["landmarks"]:
        picture = store.drives.thumbnail(survey_id, one["id"]) if one["thumbnail"] else None
        name = f"{_file_name(pipe)}_{survey_id}_{one['id']:03d}.jpg" if picture is not None else ""
        if picture is not None:
            photos.append(Photo(name, picture))
        landmarks.append({**one, "photo": name, "survey": survey_id})
    return landmarks, photos


def _sheet(survey_id: int, result: Mapping[str, Any], verdict: str, station: float | None) -> DiameterSheet:
    profile = result.get("profile") or {}
    water = profile.get("water")
    ovality = profile.get("ovality_percent")
    interval = result.get("interval_mm")
    return DiameterSheet(
        survey=survey_id,
        verdict=verdict,
        reasons=tuple(result["reasons"]),
        diameter_mm=result["diameter_mm"],
        interval_mm=None if interval is None or None in interval else (interval[0], interval[1]),
        minimum_mm=profile.get("minimum_mm"),
        maximum_mm=profile.get("maximum_mm"),
        ovality=None if ovality is None else ovality / 100,
        dn=(result.get("dn") or {}).get("name"),
        station=station,
        position=result.get("position"),
        camera=str(result.get("camera") or ""),
        frames_mm=tuple(frame["diameter_mm"] for frame in result["frames"] if frame["diameter_mm"] is not None),
        profile_mm=tuple(
            None if radius is None else (radius * math.cos(math.radians(angle)), radius * math.sin(math.radians(angle)))
            for angle, radius in zip(profile.get("angles_deg", ()), profile.get("radii_mm", ()), strict=True)
        ),
        water_mm=None if water is None else water["depth_mm"],
    )


def _cloud(survey_id: int, cloud: Mapping[str, Any], station: float | None) -> Cloud:
    fitted = cloud.get("cylinder") or {}
    return Cloud(
        survey_id,
        tuple((x, y, z) for x, y, z in cloud["points"]),
        tuple(bool(flag) for flag in cloud["inlier"]),
        tuple(fitted["axis"]) if fitted else None,
        tuple(fitted["point"]) if fitted else None,
        station,
    )


def _file_name(text: str) -> str:
    """Letters, digits, dash and underscore of a name, for a file in an archive."""
    return (
        "".join(letter if letter.isascii() and (letter.isalnum() or letter in "-_") else "_" for letter in text)[:40] or "pipe"
    )
