"""Scans of the anomaly survey on their way into a report: what most pairs say, codes, tables and pictures."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from device.anomaly.scan import concluded, same
from device.anomaly.survey import moved
from device.anomaly.views import map_json, packed, unpacked
from device.clock import Clock
from device.export.base import Options
from device.export.formats import files
from device.inspections.assemble import assemble
from device.inspections.coding import observations
from device.inspections.model import Inspection
from device.inspections.rules import faults
from device.store import NewRecording, Store
from tests.browser.fake_anomaly import CAMERA, deposit_map, pair_result, picture
from tests.unit.device.inspections import whole


def region(kind: str, peak: float, clock: float = 6.0, **other: object) -> dict[str, object]:
    found = {"survey": 4, "number": 1, "kind": kind, "peak_mm": peak, "clock": clock, "width_hours": 2.0, "chainage_m": 15.0}
    return {**found, "area_mm2": 1500.0, "confidence": 0.9, "expected": False, "height_mm": 400.0, **other}


def coded(*regions: dict[str, object], joints: tuple[dict[str, object], ...] = ()) -> list[tuple[object, ...]]:
    inspection = replace(whole(), landmarks=(), diameters=(), anomalies=regions, joints=joints)
    return [(o.code, o.ch1, o.q1, o.clock_from, o.clock_to) for o in observations(inspection)[1:-1]]


def test_each_kind_of_region_has_its_code_and_only_a_known_height_a_share() -> None:
    assert coded(region("deposit", -40.0)) == [("BBC", "Z", 10.0, 5, 7)]
    assert coded(region("deposit", -40.0, height_mm=None)) == [("BBC", "Z", None, 5, 7)]
    assert coded(region("intrusion", -12.0, 12.0)) == [("BBB", "Z", None, 11, 1)]
    assert coded(region("object", -30.0, 3.0)) == [("BBE", "Z", None, 2, 4)]
    assert coded(region("loss", 14.0, 9.0)) == [("BAF", "Z", None, 8, 10)]


def test_what_is_expected_or_unsure_is_listed_and_not_coded() -> None:
    assert coded(region("joint", 8.0, expected=True), region("loss", 6.0, confidence=0.3)) == []


def test_only_a_joint_displaced_by_a_centimetre_is_coded() -> None:
    joint = {"survey": 4, "chainage_m": 15.2, "offset_mm": 14.6, "offset_clock": 4.0}
    joints = (joint, {**joint, "chainage_m": 16.0, "offset_mm": 4.0})
    assert coded(joints=joints) == [("BAJ", "B", 15, 4, None)]


def test_a_scan_says_what_most_of_its_pairs_say() -> None:
    seen = pair_result()
    alone = pair_result(regions=seen["regions"][:1])
    found, chosen = concluded([alone, seen, {**alone, "score_mm": 0.9}], CAMERA, 12.0)
    assert chosen == 1
    assert [(one["kind"], one["seen_in"], one["chainage_m"]) for one in found["regions"]] == [("deposit", 3, 12.95)]
    assert (found["unconfirmed"], found["score_range_mm"]) == (1, [0.712, 0.9])
    refusal = {"fitted": False, "reason": "pair_too_smooth"}
    found, chosen = concluded([seen, refusal, refusal], CAMERA, None)
    assert (chosen, found["verdict"], found["reasons"]) == (None, "retry", ["pair_too_smooth"])
    assert concluded([], CAMERA, None)[0]["reasons"] == ["camera_lost"]


def test_regions_are_of_one_thing_where_they_touch_on_the_same_side_of_the_wall() -> None:
    one = {"peak_mm": -9.0, "from_m": 0.5, "to_m": 0.6, "clock": 11.8, "width_hours": 0.4}
    assert same(one, {**one, "clock": 0.3})  # over twelve
    assert not same(one, {**one, "peak_mm": 9.0})
    assert not same(one, {**one, "from_m": 0.64, "to_m": 0.7})
    assert not same(one, {**one, "clock": 1.2})


def test_a_camera_that_moved_is_noticed_and_noise_is_not() -> None:
    rng = np.random.default_rng(1)
    scene = rng.integers(40, 200, (60, 96)).astype(np.uint8).repeat(8, axis=0).repeat(8, axis=1)
    noisy = [np.clip(scene + rng.normal(0, 3, scene.shape), 0, 255).astype(np.uint8) for _ in range(3)]
    assert not moved(noisy)
    assert moved([noisy[0], np.roll(noisy[1], 8, axis=1)])


def test_the_kept_map_comes_back_as_it_was() -> None:
    found, back = deposit_map(), unpacked(packed(deposit_map()))
    np.testing.assert_array_equal(np.isnan(back.deviation), np.isnan(np.where(found.wall, found.deviation, np.nan)))
    assert np.nanmax(np.abs(back.deviation - found.deviation)) <= 0.03e-3
    np.testing.assert_array_equal(back.hidden, found.hidden & found.wall)
    thinned = np.array(map_json(back)["deviation_mm"], dtype=float)
    row, column = np.unravel_index(np.nanargmin(thinned), thinned.shape)
    assert 0.3 + (row + 0.5) / 40 * 1.2 == pytest.approx(0.95, abs=0.06)
    assert (9 + (column + 0.5) / 72 * 12) % 12 == pytest.approx(6, abs=0.3)


@pytest.fixture
def scanned(tmp_path: Path) -> Inspection:
    """An inspection with one scan out of the store, and one that was refused."""
    store = Store(tmp_path, Clock(tmp_path / "none"))
    nodes = [store.places.create_node(name)["id"] for name in ("M1", "M2")]
    pipe = store.places.create_pipe({"name": "M1-M2", "start_node": nodes[0], "end_node": nodes[1], "length_m": 30.0})["id"]
    number = store.inspections.begin(pipe, {"date": "2026-06-01T09:00:00Z", "length_m": 30.0})
    seen = pair_result(height_mm=400.0)
    for results in ([seen, seen, seen], [{"fitted": False, "reason": "pair_too_smooth"}]):
        result, chosen = concluded(results, CAMERA, 12.0)
        survey = store.surveys.begin("anomaly", pipe)
        kept = {} if chosen is None else {"overlay": picture(True), "map": packed(deposit_map())}
        recording = NewRecording(CAMERA, None, 3, result, None, {}, picture_color=picture(False), **kept)
        store.surveys.conclude(survey, "saved", [recording], result)
        store.inspections.add_survey(number, survey)
    inspection = assemble(store, number)
    store.close()
    return inspection


def test_a_scan_goes_out_with_the_inspection_in_every_format(scanned: Inspection) -> None:
    assert faults(scanned) == []
    deposit = next(one for one in scanned.observations if one.code == "BBC")
    assert (deposit.station, deposit.q1, deposit.clock_from, deposit.clock_to) == (12.95, 6, 5, 7)
    assert scanned.photo(deposit.photo) is not None
    tables = files("csv", scanned, Options())
    rows = list(csv.DictReader(io.StringIO(tables["deviations.csv"].decode("utf-8-sig"))))
    assert [(row["kind"], row["chainage_m"]) for row in rows] == [("loss", "12.6"), ("deposit", "12.95")]
    bands = list(csv.DictReader(io.StringIO(tables["deviation_scores.csv"].decode("utf-8-sig"))))
    assert (len(bands), bands[0]["from_m"]) == (12, "12.3")
    told = json.loads(files("json", scanned, Options())["inspection.json"])
    assert [sheet["verdict"] for sheet in told["scans"]] == ["accept", "retry"]
    for language in ("en", "de"):
        assert files("pdf", scanned, Options(language))["report.pdf"].startswith(b"%PDF")
