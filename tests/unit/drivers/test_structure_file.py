"""The structure file, the true map in it, and the solids it is built of."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.base import RecordingBroken
from drivers.virtual.chamber.objects import CLASSES, PORTS, SIZES_M, solids_of
from drivers.virtual.chamber.path import VehiclePath, rotation_of
from drivers.virtual.chamber.scanner import VirtualScanner, tank_ranges
from drivers.virtual.chamber.solids import Box, Cylinder, Sphere, cast
from drivers.virtual.chamber.structure import Path_, Structure, Tank, load_structure
from drivers.virtual.chamber.variations import varied

CROSS = {
    "pipes": [
        {"from": [0, 0, 4], "to": [0.4, 0, 4]},
        {"from": [0.4, 0, 4], "to": [1, 0, 4]},
        {"from": [0.4, 0, 4], "to": [0.4, 0, 3]},
    ],
    "objects": [{"class": "tee", "position": [0.4, 0, 4], "axis": [1, 0, 0], "branch": [0, 0, -1]}],
}


def _load(folder: Path, content: Any) -> Structure:
    path = folder / "structure.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return load_structure(path)


def test_the_papers_structure_has_12_pipes_20_objects_and_6_classes() -> None:
    structure = load_structure()
    assert (len(structure.runs), len(structure.objects)) == (12, 20)
    assert {thing.label for thing in structure.objects} == set(CLASSES)
    points = np.array([end for run in structure.runs for end in (run.start, run.end)])
    assert np.ptp(points, axis=0) == pytest.approx([1.4, 1.4, 1.2], abs=0.15)
    assert {edge.object for edge in structure.edges} == set(range(20))


def test_no_object_has_more_pipes_than_ports_and_all_leave_through_one() -> None:
    for structure in (load_structure(), *(varied(seed) for seed in (1, 2, 3))):
        for number, thing in enumerate(structure.objects):
            for edge in structure.edges:
                if edge.object == number:
                    run = structure.runs[edge.pipe]
                    axis = (run.end - run.start) / np.linalg.norm(run.end - run.start)
                    assert np.abs(thing.ports @ axis).max() > 0.99
            assert np.linalg.det(thing.rotation) == pytest.approx(1.0)


def test_pipes_in_line_that_meet_in_an_object_are_one_run(tmp_path: Path) -> None:
    structure = _load(tmp_path, CROSS)
    assert len(structure.runs) == 2
    assert sorted(edge.kind for edge in structure.edges) == ["end", "through"]


def test_pipes_in_line_with_nothing_between_stay_two(tmp_path: Path) -> None:
    apart = {"pipes": [{"from": [0, 0, 4], "to": [0.4, 0, 4]}, {"from": [0.6, 0, 4], "to": [1, 0, 4]}]}
    assert len(_load(tmp_path, apart).runs) == 2


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ("{", "no JSON"),
        ({"pipes": []}, "pipes"),
        ({**CROSS, "pump": 1}, "pump"),
        ({"pipes": [{"from": [0, 0, 4], "to": [0, 0, 4]}]}, "shorter"),
        ({**CROSS, "objects": [{"class": "teapot", "position": [0, 0, 0], "axis": [1, 0, 0]}]}, "class"),
        ({**CROSS, "objects": [{"class": "tee", "position": [0, 0, 0], "axis": [1, 0, 0]}]}, "branch"),
        ({**CROSS, "objects": [{"class": "ball valve", "position": [0, 0, 0], "axis": [1, 0, 0]}]}, "handle"),
        ({**CROSS, "objects": [{"class": "socket", "position": [0, 0, 0], "axis": [0, 0, 0]}]}, "length"),
        (
            {**CROSS, "objects": [{"class": "tee", "position": [0, 0, 0], "axis": [1, 0, 0], "branch": [1, 1, 0]}]},
            "right angles",
        ),
        ({**CROSS, "scanner": {"noise_m": -1}}, "noise_m"),
        ({**CROSS, "path": {"duration_s": float("inf")}}, "duration_s"),
        ({"pipes": [{"from": [0, 0, 4], "to": [1, 0, 4], "radius": 0.03}]}, "pipes 1 radius"),
        ({**CROSS, "objects": [{"class": "socket", "position": [0, 2, 4], "axis": [1, 0, 0]}]}, "no pipe"),
        ({"pipes": [{"from": [0, 0, 4], "to": [0, 0, 6]}]}, "pipe 1 does not lie in the tank"),
        ({**CROSS, "path": {"radius_m": [3, 7]}}, "leaves the water"),
        ({**CROSS, "path": {"waypoints": [[3, 0, 3], [0, 3, 3], [-3, 0, -1], [0, -3, 3]]}}, "leaves the water"),
        ({**CROSS, "scanner": {"range_m": [5, 1]}}, "nearer range"),
        ({**CROSS, "scanner": {"field_deg": [400, 30]}}, "field_deg"),
    ],
)
def test_a_file_that_cannot_be_says_why(tmp_path: Path, content: Any, why: str) -> None:
    with pytest.raises(RecordingBroken, match=why) as caught:
        _load(tmp_path, content)
    assert "\n" not in str(caught.value)


def test_a_handle_may_stand_on_either_side_of_a_three_way_valve(tmp_path: Path) -> None:
    for side in (1, -1):
        valve = {
            "class": "3-way valve",
            "position": [0.4, 0, 4],
            "axis": [1, 0, 0],
            "branch": [0, 0, -1],
            "handle": [0, side, 0],
        }
        thing = _load(tmp_path, {**CROSS, "objects": [valve]}).objects[0]
        np.testing.assert_allclose(thing.handle, [0, side, 0])
        np.testing.assert_allclose(thing.rotation[:, 1], [0, 0, -1])


@pytest.mark.parametrize("label", CLASSES)
def test_objects_have_the_sizes_of_table_1(label: str) -> None:
    """Measured by rays from the six sides: the least distance to each side of a box around the object."""
    is_open = label not in ("ball valve", "3-way valve")
    solids = solids_of(label, is_open)
    steps = np.linspace(-0.3, 0.3, 241)
    extents = []
    for axis in range(3):
        others = [k for k in range(3) if k != axis]
        origins = np.zeros((len(steps) ** 2, 3))
        origins[:, others] = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
        reach = 0.0
        for side in (1.0, -1.0):
            origins[:, axis] = side
            directions = np.zeros_like(origins)
            directions[:, axis] = -side
            reach += 1.0 - cast(solids, origins, directions)[0].min()
        extents.append(reach)
    assert extents == pytest.approx(SIZES_M[label], abs=0.003)
    assert len(PORTS[label]) in (2, 3)


def test_ranges_by_hand() -> None:
    origin = np.zeros((3, 3))
    rays = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0]])
    solids = [
        Sphere(np.array([3.0, 0, 0]), 0.5),
        Box(np.array([0, 4.0, 0]), np.array([1.0, 0.25, 1.0]), np.eye(3)),
        Cylinder(np.array([0, 0, 2.0]), np.array([0, 0, 3.0]), 0.1),
    ]
    ranges, which = cast(list(solids), origin, rays)
    assert ranges == pytest.approx([2.5, 3.75, 2.0])
    assert which.tolist() == [0, 1, 2]
    side = Cylinder(np.array([2.0, -1, 0]), np.array([2.0, 1, 0]), 0.1).cast(origin[:1], rays[:1])
    assert side == pytest.approx([1.9])
    assert np.isinf(cast(list(solids), origin[:1], -rays[:1])[0][0])


def test_the_tank_has_a_floor_walls_and_slopes() -> None:
    tank = Tank(size_m=(10, 8), depth_m=5, slope_width_m=2, slope_height_m=2)
    at = np.array([[0.0, 0, 3.0]] * 4)
    rays = np.array([[0, 0, 1.0], [0, 1.0, 0], [0, 0, -1.0], [1.0, 0, 0]])
    # north of 3 m the floor rises at 45 degrees: at 3 m depth it is met where it has risen by 2 m, at the wall
    assert tank_ranges(tank, at, rays) == pytest.approx([2.0, 4.0, np.inf, 5.0])
    assert tank_ranges(tank, np.array([[0.0, 0, 4.0]]), rays[3:]) == pytest.approx([4.0])


def test_velocity_is_what_the_position_does() -> None:
    path = VehiclePath(Path_(), np.random.default_rng(0))
    step = 1e-4
    for time_s in (10.0, 200.0, 480.0):
        moved = (path.pose(time_s + step).position - path.pose(time_s - step).position) / (2 * step)
        np.testing.assert_allclose(rotation_of(path.pose(time_s).attitude) @ path.velocity(time_s), moved, atol=1e-6)


def test_a_scan_is_the_same_for_the_same_noise_and_its_points_lie_on_something() -> None:
    structure = load_structure()
    scanner = VirtualScanner(structure, VehiclePath(structure.description.path, np.random.default_rng(0)))
    one, two = (scanner.scan(50.0, np.random.default_rng(5)) for _ in range(2))
    np.testing.assert_array_equal(one.points, two.points)
    assert len(one.points) > 5000
    assert one.late_s is not None
    assert np.abs(one.late_s).max() <= structure.description.scanner.sweep_s / 2
    ranges = np.linalg.norm(one.points, axis=1)
    assert ranges.max() < structure.description.scanner.range_m[1] + 0.05
    assert len(scanner.times()) == 245
