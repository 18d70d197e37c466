"""Pipe lists from other programs: CSV as spreadsheets write it, GeoJSON lines; what is wrong is said with its line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from device.clock import Clock
from device.errors import Invalid
from device.inspections.model import PipeRecord
from device.inspections.pipe_list import read_pipe_list
from device.store import Store

CSV = "name,upstream,downstream,material,shape,dn,length_m\nA-B,A,B,clay,egg,300,41.5\nB-C,B,C,,,,\n"


def test_a_list_with_what_is_known() -> None:
    first, second = read_pipe_list(CSV.encode(), "pipes.csv")
    assert (first.name, first.upstream.name, first.downstream.name) == ("A-B", "A", "B")
    assert (first.material, first.shape, first.dn_mm, first.length) == ("clay", "egg", 300, 41.5)
    assert (second.material, second.shape, second.dn_mm, second.length) == ("unknown", "circular", None, None)


def test_as_a_german_spreadsheet_writes_it() -> None:
    text = "﻿Name;Upstream;Downstream;Length_m;upstream_easting;upstream_northing\nStraße 1;M1;M2;12,5;565000,25;5933000\n"
    for encoded in (text.encode("utf-8"), text.removeprefix("﻿").encode("latin-1")):
        (pipe,) = read_pipe_list(encoded, "list.CSV")
        assert (pipe.name, pipe.length, pipe.upstream.easting) == ("Straße 1", 12.5, 565000.25)
        assert pipe.upstream.placed
        assert not pipe.downstream.placed


def test_geojson_lines() -> None:
    line = {"type": "LineString", "coordinates": [[9.0, 53.0], [9.0005, 53.0], [9.001, 53.0]]}
    feature = {"type": "Feature", "geometry": line, "properties": {"name": "P", "upstream": "A", "downstream": "B", "dn": 300}}
    point = {"type": "Feature", "geometry": {"type": "Point", "coordinates": [9, 53]}, "properties": {}}
    (pipe,) = read_pipe_list(json.dumps({"type": "FeatureCollection", "features": [point, feature]}).encode(), "p.geojson")
    assert (pipe.upstream.easting, pipe.downstream.easting, pipe.dn_mm) == (9.0, 9.001, 300)


@pytest.mark.parametrize(
    ("text", "name", "says"),
    [
        ("", "p.csv", "lacks the column name"),
        ("name,upstream\nA,B\n", "p.csv", "lacks the column downstream"),
        ("name,upstream,downstream\n", "p.csv", "holds no pipe"),
        ("name,upstream,downstream\nP,A,\n", "p.csv", "downstream is missing in line 2"),
        ("name,upstream,downstream,dn\nP,A,B,wide\n", "p.csv", "dn in line 2 is wide"),
        ("name,upstream,downstream,material\nP,A,B,cheese\n", "p.csv", "material cheese in line 2"),
        ("name,upstream,downstream,shape\nP,A,B,square\n", "p.csv", "shape square in line 2"),
        ("name,upstream,downstream\nP,A,B\nP,B,C\n", "p.csv", "P stands in the list twice"),
        ("{}", "p.geojson", "no GeoJSON"),
        ('{"features": [{"geometry": {"type": "LineString", "coordinates": []}}]}', "p.json", "no GeoJSON"),
        ("not json", "p.geojson", "no GeoJSON"),
    ],
)
def test_what_is_wrong_is_said(text: str, name: str, says: str) -> None:
    with pytest.raises(Invalid, match=says):
        read_pipe_list(text.encode(), name)


def test_a_list_is_added_whole_or_not_at_all(tmp_path: Path) -> None:
    store = Store(tmp_path, Clock())
    listed = read_pipe_list(CSV.encode(), "pipes.csv")
    assert store.places.add_all(listed, 25832) == {"pipes": 2, "nodes": 3, "there": 0}
    assert store.places.site()["crs"] == 25832
    assert store.places.add_all(listed, None) == {"pipes": 0, "nodes": 0, "there": 2}
    bad = [
        PipeRecord("new", listed[0].upstream, listed[0].downstream),
        PipeRecord("x" * 200, listed[0].upstream, listed[1].downstream),
    ]
    with pytest.raises(Invalid):
        store.places.add_all(bad, None)
    assert [pipe["name"] for pipe in store.places.pipes()] == ["A-B", "B-C"]
    with pytest.raises(Invalid, match="convert the list first"):
        store.places.add_all(listed, 4326)
    store.close()


def test_a_list_with_a_pipe_in_a_circle(tmp_path: Path) -> None:
    store = Store(tmp_path, Clock())
    with pytest.raises(Invalid, match="The pipe C-C would begin and end at the same manhole"):
        store.places.add_all(read_pipe_list(b"name,upstream,downstream\nA-B,A,B\nC-C,C,C\n", "pipes.csv"), None)
    assert store.places.nodes() == store.places.pipes() == [], "all of a list, or nothing"
    store.close()
