"""The chamber of the demo inspection: a small virtual one, scanned and mapped by what scans and maps real ones."""

from __future__ import annotations

from device.store import Store
from device.structure.course import Course, CourseSetup
from device.structure.run import VirtualChamber
from device.structure.survey import concluded, summary
from drivers.virtual.chamber.structure import SMALL, load_structure

SCANS = 12


def map_chamber(store: Store, node_id: int, seed: int) -> int:
    """Put a structure survey of a node into ``store``; its number."""
    chamber = VirtualChamber(load_structure(SMALL), seed)
    mount = chamber.scanner.mount
    rows = tuple(tuple(float(x) for x in row) for row in mount.rotation)
    offset = tuple(float(x) for x in mount.offset)
    setup = CourseSetup(rows, offset, chamber.structure.runs[0].radius, upright=False, depths=True, seed=seed)
    course = Course(setup)
    for event in chamber.events(SCANS):
        course.take(event)
    found = concluded(course)
    assert found is not None  # the chamber has scans
    survey = store.structures.begin(node_id, {"radius_m": setup.radius_m, "upright": False, "scanner": "virtual", "seed": seed})
    store.structures.keep(survey, found, summary(found, course.times[-1]), "saved")
    return survey
