"""The shipped knowledge of issue "Structure": data base of views, and confusion matrices from views that are not in it.

    python -m tests.bench.structure_fit                    prints the confusion matrices of six variations (see SEEDS)
    python -m tests.bench.structure_fit --save FILE.npz    and saves what the box ships (device/data/structure/knowledge.npz)

The views are objects as they are cut out of scans of variations of the paper's structure (other places, other classes, other
noise), on another path each; no figure is reported on those seeds. Four scans in a row make a fused one.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from device.structure.database import save_knowledge, views
from device.structure.run import VirtualChamber
from drivers.virtual.chamber.structure import Structure
from drivers.virtual.chamber.variations import varied
from estimators.structure.apart import take_apart, undistorted
from estimators.structure.fusion import fused
from estimators.structure.handles import handle_height
from estimators.structure.mapper import Knowledge
from estimators.structure.recognition import Views, describe, nearest_class
from estimators.structure.types import CLASSES
from estimators.structure.vehicle import body_rates
from tests.bench.table import print_table

Array = NDArray[np.float64]

SEEDS = (101, 102, 201, 202, 203, 204)
PLACES = 9
IN_A_ROW = 4
SAME_HANDLE = (("elbow", "tee", "socket"), ("ball valve", "3-way valve"), ("butterfly valve",))
"""What differs within these from count to count is how their few handles happen to stand."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=len(SEEDS), help="how many of the variations")
    parser.add_argument("--save", type=Path, help="save data base and matrices")
    arguments = parser.parse_args()
    base = views()
    single, together = np.full((2, len(CLASSES), len(CLASSES)), 0.5)
    handles = np.full((len(CLASSES), 3), 1.0)
    for seed in SEEDS[: arguments.seeds]:
        count(seed, base, single, together, handles)
    handles = _pooled(handles)
    show("Recognised by one scan (rows: actual)", single)
    show("Recognised by four scans fused", together)
    print_table(
        "What stands above it (rows: actual)",
        ["%", "nothing", "low", "high"],
        [[label, *(f"{100 * share:.0f}" for share in _shares(handles)[k])] for k, label in enumerate(CLASSES)],
    )
    if arguments.save is not None:
        save_knowledge(Knowledge(base, _shares(single), _shares(together), _doubted(_shares(handles))), arguments.save)


def count(seed: int, base: Views, single: Array, together: Array, handles: Array) -> None:
    """Add what the objects of one variation are recognised as, from true poses."""
    structure = varied(seed)
    chamber = VirtualChamber(structure, seed)
    rng = np.random.default_rng([seed, 9])
    mount = chamber.scanner.mount
    for begin in np.linspace(10.0, chamber.path.duration_s - 20.0, PLACES):
        clouds: dict[int, list[Array]] = {}
        for number in range(IN_A_ROW):
            time_s = float(begin + 2 * number)
            scan = chamber.scanner.scan(time_s, rng)
            pose = chamber.path.pose(time_s)
            turning = body_rates(pose.attitude, chamber.path.attitude_rate(time_s))
            speed = chamber.path.velocity(time_s) + np.cross(turning, mount.offset)
            points = undistorted(scan.points, scan.late_s, mount.rotation.T @ speed, mount.rotation.T @ turning)
            rotation, place = pose.rotation @ mount.rotation, pose.position + pose.rotation @ mount.offset
            for sighting in take_apart(points, rng).sightings:
                here = place + rotation @ sighting.position
                away = [float(np.linalg.norm(here - thing.position)) for thing in structure.objects]
                true = int(np.argmin(away))
                if away[true] > 0.08:
                    continue
                actual = CLASSES.index(structure.objects[true].label)
                height = handle_height(sighting.cloud, sighting.position, _pipes(structure, true) @ rotation)
                if height is not None:
                    handles[actual, height] += 1
                _add(single, actual, sighting.cloud, base)
                seen = clouds.setdefault(true, [])
                seen.append(place + sighting.cloud @ rotation.T)
                if len(seen) > 1:
                    _add(together, actual, fused([(cloud - place) @ rotation for cloud in reversed(seen)]), base)


def _pipes(structure: Structure, number: int) -> Array:
    """Unit vectors (n, 3) of the pipes that leave a true object, as a map knows them after a while."""
    place = structure.objects[number].position
    found = []
    for edge in structure.edges:
        if edge.object == number:
            run = structure.runs[edge.pipe]
            found += [
                (end - place) / np.linalg.norm(end - place)
                for end in (run.start, run.end)
                if np.linalg.norm(end - place) > 0.16
            ]
    return np.array(found).reshape(-1, 3)


def _add(table: Array, actual: int, cloud: Array, base: Views) -> None:
    found = describe(cloud)
    if found is not None:
        table[actual, nearest_class(found, base)[0]] += 1


def _shares(table: Array) -> Array:
    shares: Array = table / table.sum(axis=1, keepdims=True)
    return shares


def _pooled(handles: Array) -> Array:
    """The counts (6, 3) of all classes with the same handle, for each of them."""
    pooled = np.empty_like(handles)
    for labels in SAME_HANDLE:
        rows = [CLASSES.index(label) for label in labels]
        pooled[rows] = handles[rows].sum(axis=0)
    return pooled


def _doubted(shares: Array) -> Array:
    """A tenth of what stands above an object may be a pipe that the map does not have yet."""
    return np.asarray(0.9 * shares + 0.1 / shares.shape[1])


def show(title: str, table: Array) -> None:
    """A confusion matrix in percent."""
    right = (np.trace(table) - 0.5 * len(CLASSES)) / (table.sum() - 0.5 * table.size)
    rows = [
        [label, *(f"{100 * share:.0f}" for share in _shares(table)[k]), f"{table[k].sum() - 3:.0f}"]
        for k, label in enumerate(CLASSES)
    ]
    print_table(f"{title}: accuracy {right:.3f}", ["%", *CLASSES, "sightings"], rows)


if __name__ == "__main__":
    main()
