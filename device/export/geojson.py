"""GeoJSON (RFC 7946): the pipe as a line and its observations as points between the nodes, in longitude and latitude."""

from __future__ import annotations

import math
from typing import Any

from device.errors import Invalid
from device.export.base import Options
from device.inspections.codes import codes
from device.inspections.model import Inspection, NodeRecord
from device.json_text import dumps


def geojson(inspection: Inspection, options: Options) -> bytes:
    """The file. Stations are spread evenly over the straight line between the nodes, so that the last lies at the end node.

    Raises Invalid where a node has no coordinates or the site no reference system.
    """
    start, end = place_of(inspection.start, inspection.crs), place_of(inspection.end, inspection.crs)
    length = _length(inspection)
    features = [
        _feature(
            {"type": "LineString", "coordinates": [_rounded(start), _rounded(end)]},
            {
                "kind": "pipe",
                "name": inspection.pipe.name,
                "site": inspection.site,
                "material": inspection.pipe.material,
                "shape": inspection.pipe.shape,
                "dn_mm": inspection.pipe.dn_mm,
                "length_m": inspection.pipe.length,
                "inspected_m": inspection.length,
                "date": inspection.date,
                "diameters_mm": [s.diameter_mm for s in inspection.diameters if s.verdict == "accept"],
            },
        )
    ]

    def at(station: float) -> dict[str, Any]:
        share = min(max(station / length, 0.0), 1.0) if length > 0 else 0.0
        place = (start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1]))
        return {"type": "Point", "coordinates": _rounded(place)}

    for one in inspection.observations:
        code = codes().get(one.code)
        features.append(
            _feature(
                at(one.station),
                {
                    "kind": "observation",
                    "number": one.number,
                    "station_m": one.station,
                    "code": one.code,
                    "text": "" if code is None else code.text(options.language),
                    "ch1": one.ch1,
                    "ch2": one.ch2,
                    "q1": one.q1,
                    "q2": one.q2,
                    "clock_from": one.clock_from,
                    "clock_to": one.clock_to,
                    "continuous": one.continuous,
                    "remark": one.remark,
                    "photo": one.photo,
                    "pipe": inspection.pipe.name,
                },
            )
        )
    features += [
        _feature(
            at(float(one["chainage_m"])),
            {
                "kind": "deviation",
                "what": one.get("kind"),
                "expected": bool(one.get("expected")),
                "confidence": one.get("confidence"),
                "station_m": one["chainage_m"],
                "peak_mm": one.get("peak_mm"),
                "area_mm2": one.get("area_mm2"),
                "clock": one.get("clock"),
                "pipe": inspection.pipe.name,
            },
        )
        for one in inspection.anomalies
        if one.get("chainage_m") is not None
    ]
    return (dumps({"type": "FeatureCollection", "features": features}) + "\n").encode()


def _length(inspection: Inspection) -> float:
    """What a station at the end node reads. Raises Invalid where nothing tells."""
    length = inspection.pipe.length if inspection.pipe.length is not None else inspection.length
    if length is None or length <= 0:
        raise Invalid("The length of the pipe is not known: enter it, then export again.")
    return length


def place_of(node: NodeRecord, crs: int | None) -> tuple[float, float]:
    """(longitude, latitude) of a node whose coordinates are in EPSG ``crs``. Raises Invalid."""
    if node.easting is None or node.northing is None:
        raise Invalid(f"The node {node.name} has no coordinates: enter them, then export again.")
    if crs is None:
        raise Invalid("The reference system of the coordinates is not known: enter its EPSG number at the site.")
    if crs == 4326:
        place = node.easting, node.northing
    else:
        from pyproj import Transformer  # here, since it brings its data base along
        from pyproj.exceptions import CRSError

        try:
            place = Transformer.from_crs(crs, 4326, always_xy=True).transform(node.easting, node.northing)
        except CRSError:
            raise Invalid(f"EPSG:{crs} is no reference system.") from None
    if not all(math.isfinite(value) for value in place) or abs(place[0]) > 180 or abs(place[1]) > 90:
        raise Invalid(f"The coordinates of the node {node.name} do not lie in EPSG:{crs}: check both.")
    return float(place[0]), float(place[1])


def _rounded(place: tuple[float, float]) -> list[float]:
    return [round(value, 8) for value in place]


def _feature(geometry: dict[str, Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}
