"""Some faults of ``python -m tests.bench.sensor_faults``: each is shown, each is over in the end, the daemon goes on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.bench.faulty_box import FaultyBox, faulty_box
from tests.bench.sensor_faults import one_fault


@pytest.fixture(scope="module")
def box(tmp_path_factory: pytest.TempPathFactory) -> Iterator[FaultyBox]:
    folder: Path = tmp_path_factory.mktemp("box")
    with faulty_box(folder, live_hz=2.0) as box:
        box.ask("/drive", "POST", {"direction": "downstream"})
        yield box
        assert box.alive, box.log.read_text()[-2000:]


@pytest.mark.parametrize(
    ("sensor", "fault"), [("camera", "killed"), ("camera", "garbage"), ("grabber", "frozen"), ("encoder", "killed")]
)
def test_a_fault_is_shown_and_over_in_the_end(box: FaultyBox, sensor: str, fault: str) -> None:
    outcome = one_fault(box, sensor, fault, lasts_s=3.0)
    assert outcome.shown_s is not None, box.sensor(sensor)
    assert outcome.recovered_s is not None, box.sensor(sensor)
    assert box.alive


def test_the_page_of_health_knows_all_of_it(box: FaultyBox) -> None:
    health = box.ask("/health")
    assert [one["role"] for one in health["sensors"]] == ["camera", "grabber", "encoder"]
    assert all(one["reconnects"] > 0 for one in health["sensors"]), "each was opened anew"
    assert health["disk_free_mb"] > 0
    assert box.ask("/lamp", "PUT", {"level": 0.8})["level"] == 0.8
    assert box.wait(lambda: box.ask("/lamp")["shining"] == 0.8, 20)
