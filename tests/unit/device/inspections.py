"""Inspections to export: one with everything in it, and a hypothesis strategy for many."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from hypothesis import strategies as st

from device.inspections.codes import codes
from device.inspections.coding import numbered, observations
from device.inspections.model import Cloud, DiameterSheet, Inspection, Instrument, NodeRecord, Observation, Photo, PipeRecord
from device.pictures import encode_jpeg

CIRCLE = tuple((200 * math.cos(math.radians(a)), 205 * math.sin(math.radians(a))) for a in range(0, 360, 5))
JPEG = encode_jpeg(np.full((12, 16, 3), 90, np.uint8))


def whole() -> Inspection:
    """A pipe of 28.3 m with landmarks, an accepted and a refused diameter, a deviation, photos, points and a chamber."""
    sheet = DiameterSheet(
        3,
        "accept",
        (),
        401.0,
        (398.0, 404.0),
        399.0,
        410.0,
        0.06,
        "DN 400",
        1.0,
        "entrance",
        "D435i",
        (400.0, 401.0),
        CIRCLE,
        40.0,
    )
    refused = DiameterSheet(4, "retry", ("aim", "few_points"), 380.0, (300.0, 460.0), station=2.0)
    inspection = Inspection(
        number=7,
        site="Elm Road & Söhne",
        crs=25832,
        pipe=PipeRecord(
            "M1-M2",
            NodeRecord("M1", 565000.0, 5933000.0, 10.5),
            NodeRecord("M2", 565020.0, 5933020.0),
            "PVC",
            "circular",
            400,
            28.3,
        ),
        operator="Ann",
        date="2026-06-01T09:00:00Z",
        direction="upstream",
        length=28.3,
        note="rain",
        photos=(Photo("M1-M2_001.jpg", JPEG),),
        diameters=(sheet, refused),
        clouds=(Cloud(3, ((0.2, 0.0, 1.0), (0.0, 0.2, 1.5)), (True, False), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0), 1.0),),
        landmarks=(
            landmark(1, "connection", 4.2, clock=2.6, photo="M1-M2_001.jpg"),
            landmark(2, "deposit", 9.0, to=11.0, clock=5.1, clock_to=7.0),
            landmark(3, "roots", 12.0, clock=12.0, decision="rejected"),
        ),
        anomalies=({"chainage_m": 15.0, "peak_mm": -22.0, "area_mm2": 1500.0, "clock": 6.2},),
        structures=(chamber(),),
        instruments=(Instrument(1, "diameter", "virtual", {"scale_error": "0.4 %"}),),
    )
    return replace(inspection, observations=observations(inspection))


def chamber() -> dict[str, object]:
    """A pipe of 1 m with an elbow at its end, as the store states a structure survey."""
    elbow = {
        "number": 2,
        "class": "elbow",
        "position": [1.0, 0.0, 4.0],
        "belief": 0.98,
        "sigma_m": 0.004,
        "pipes": [[-1.0, 0.0, 0.0]],
        "orientation": None,
        "open": None,
    }
    return {
        "survey_id": 12,
        "node": {"id": 1, "name": "M1"},
        "summary": {"scans": 40},
        "consistent": True,
        "pipes": [{"number": 1, "from": [0.0, 0.0, 4.0], "to": [1.0, 0.0, 4.0], "radius_m": 0.0315}],
        "objects": [elbow],
        "edges": [{"pipe": 1, "object": 2, "kind": "end", "along_m": 1.0, "belief": 0.99}],
    }


def landmark(number: int, label: str, at: float, to: float | None = None, **more: object) -> dict[str, object]:
    """As the store states it."""
    return {
        "id": number,
        "class": label,
        "status": "passed",
        "chainage_m": at,
        "chainage_to_m": at if to is None else to,
        "clock": None,
        "clock_to": None,
        "sigma_chainage_m": 0.02,
        "decision": None,
        "corrected": None,
        "note": "",
        **more,
    }


_TEXT = st.text(max_size=25)
_NAME = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), min_size=1, max_size=25)
_METRES = st.floats(0.0, 90.0).map(lambda value: round(value, 2))
_HOUR = st.none() | st.integers(1, 12)


@st.composite
def any_inspection(draw: st.DrawFn) -> Inspection:
    """Whatever an operator may have entered and the surveys may have found."""
    upstream, downstream, name = draw(st.lists(_NAME, min_size=3, max_size=3, unique=True))
    length = draw(st.floats(1.0, 95.0).map(lambda value: round(value, 2)))
    photos = tuple(Photo(f"p_{k}.jpg", JPEG) for k in range(draw(st.integers(0, 3))))
    found = [draw(_any_observation(length, [photo.name for photo in photos])) for _ in range(draw(st.integers(0, 8)))]
    for number in range(1, draw(st.integers(0, 2)) + 1):
        first, last = sorted((draw(st.floats(0, length)), draw(st.floats(0, length))))
        clock = draw(st.integers(1, 12))
        for letter, at in (("A", first), ("B", last)):
            found.append(Observation(round(at, 2), "BBC", ch1="Z", clock_from=clock, continuous=f"{letter}{number}"))
    east, north = (draw(st.none() | st.floats(0, limit, exclude_max=True)) for limit in (9e7, 9e6))
    node = NodeRecord(upstream, east, north, draw(st.none() | st.floats(-100, 8000)))
    sheet = DiameterSheet(
        1,
        draw(st.sampled_from(("accept", "retry"))),
        (),
        draw(st.none() | st.floats(100, 1200)),
        None,
        profile_mm=draw(st.sampled_from(((), CIRCLE, (None, *CIRCLE[1:])))),
    )
    ends = (Observation(0.0, "BCD"), Observation(length, "BCE"))
    return Inspection(
        number=draw(st.integers(1, 10_000)),
        site=draw(_NAME)[:20],
        crs=25832,
        pipe=PipeRecord(
            name,
            node,
            NodeRecord(downstream),
            draw(st.sampled_from(("PVC", "concrete", "clay", "PE", "PP", "GRP", "ductile iron", "unknown"))),
            draw(st.sampled_from(("circular", "egg", "oval", "other"))),
            draw(st.none() | st.integers(50, 4000)),
            draw(st.none() | st.just(length)),
        ),
        operator=draw(_TEXT),
        date=draw(st.dates().map(lambda day: f"{day.isoformat()}T10:20:30Z")),
        direction=draw(st.sampled_from(("downstream", "upstream"))),
        method=draw(st.sampled_from(("crawler", "rod", "pushrod", "manhole"))),
        length=length,
        note=draw(_TEXT),
        photos=photos,
        diameters=(sheet,),
        observations=numbered([*ends, *found]),
    )


@st.composite
def _any_observation(draw: st.DrawFn, length: float, photos: list[str]) -> Observation:
    code = codes()[draw(st.sampled_from([name for name in codes() if name not in ("BCD", "BCE", "BDC")]))]
    hour = draw(st.integers(1, 12) if code.clock == "one" else _HOUR)
    return Observation(
        station=draw(_METRES.filter(lambda at: at <= length)),
        code=code.code,
        ch1=draw(st.sampled_from(["", *code.ch1])),
        ch2=draw(st.sampled_from(["", *code.ch2])),
        q1=draw(st.none() | st.floats(0, 100).map(lambda value: round(value, 1))),
        clock_from=hour,
        clock_to=None if hour is None else draw(_HOUR),
        at_joint=draw(st.booleans()),
        remark=draw(_TEXT),
        photo=draw(st.sampled_from(["", *photos])),
        source=draw(_TEXT),
    )
