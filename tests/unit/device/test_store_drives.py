"""The store of the landmarks survey: written as the drive goes on, never losing what was shown as saved."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from device.errors import NotFound
from device.store import Kept, KeptLandmark, Store
from tests.unit.device.test_store import SteeredClock, saved

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture
def clock(tmp_path: Path) -> SteeredClock:
    return SteeredClock(tmp_path / "no-machine")


@pytest.fixture
def store(tmp_path: Path, clock: SteeredClock) -> Store:
    return Store(tmp_path / "data", clock)


def measured(chainage_m: float = 3.2, label: str = "connection") -> dict[str, Any]:
    return {
        "class": label,
        "status": "confirmed",
        "chainage_m": chainage_m,
        "chainage_to_m": chainage_m,
        "clock": 2.5,
        "clock_to": 2.5,
        "belief": {label: 0.9, "false": 0.1},
    }


def landmark(number: int, chainage_m: float = 3.2, thumbnail: bytes | None = b"jpeg") -> KeptLandmark:
    return KeptLandmark(number, measured(chainage_m), thumbnail)


def driven(store: Store, *landmarks: KeptLandmark, pipe_id: int | None = None) -> int:
    survey_id = store.drives.begin(pipe_id, {"direction": "downstream", "radius_m": 0.15})
    store.drives.keep(survey_id, Kept(landmarks=landmarks))
    return survey_id


def test_a_drive_comes_back_as_it_was_kept_bit_by_bit(store: Store) -> None:
    pipe = store.places.create_pipe({"name": "H1"})
    survey_id = driven(store, landmark(2, 8.0), landmark(1), pipe_id=pipe["id"])
    rings = [{"chainage_m": 1.0, "sightings": 4}]
    store.drives.keep(survey_id, Kept(landmarks=[landmark(1, 3.25, None)], rings=rings, log=[1]))
    fault = {"time_s": 2.0, "chainage_m": 1.1, "what": "encoder", "text": "The encoder was unplugged."}
    summary = {"from_m": 0.0, "to_m": 9.5, "frames": 250, "seconds": 10.0, "landmarks": 2}
    store.drives.keep(survey_id, Kept(faults=[fault], log=[2, 3], summary=summary), state="saved")
    found = store.drives.map(survey_id)
    assert [row["id"] for row in found["landmarks"]] == [1, 2]
    assert found["landmarks"][0]["chainage_m"] == 3.25
    assert found["landmarks"][0]["thumbnail"] is True
    assert store.drives.thumbnail(survey_id, 1) == b"jpeg"  # the second writing brought none
    assert found["rings"] == rings
    assert found["faults"] == [fault]
    assert (found["state"], found["direction"], found["radius_m"], found["to_m"]) == ("saved", "downstream", 0.15, 9.5)
    assert found["pipe"]["name"] == "H1"
    assert store.drives.log(survey_id) == [1, 2, 3]


def test_a_double_disappears_unless_somebody_spoke_of_it(store: Store) -> None:
    survey_id = driven(store, landmark(1), landmark(2), landmark(3))
    store.drives.say(survey_id, 2, {"decision": "confirmed"}, "Ada")
    store.drives.keep(survey_id, Kept(gone=[2, 3]))
    assert [row["id"] for row in store.drives.map(survey_id)["landmarks"]] == [1, 2]


def test_who_said_what_is_added_and_the_measured_values_stay(store: Store) -> None:
    survey_id = driven(store, landmark(1))
    store.drives.say(survey_id, 1, {"decision": "confirmed", "clock": 3.0, "note": "wet"}, "Ada")
    said = store.drives.say(survey_id, 1, {"decision": "rejected"}, "Ben")
    assert (said["decision"], said["corrected"], said["note"]) == ("rejected", {"clock": 3.0}, "wet")
    assert said["clock"] == 2.5
    assert [(word["by"], word["decision"]) for word in said["history"]] == [("Ada", "confirmed"), ("Ben", "rejected")]
    store.drives.keep(survey_id, Kept(landmarks=[landmark(1, 3.4)]))  # the next second of the drive takes nothing back
    undone = store.drives.say(survey_id, 1, {"decision": None, "clock": None}, "Ada")
    assert (undone["decision"], undone["corrected"], undone["chainage_m"]) == (None, None, 3.4)
    assert len(undone["history"]) == 3


def test_what_is_not_there_is_not_found(store: Store) -> None:
    survey_id = driven(store, landmark(1))
    diameter = saved(store)
    for ask in (
        lambda: store.drives.map(99),
        lambda: store.drives.map(diameter),
        lambda: store.drives.landmark(survey_id, 5),
        lambda: store.drives.thumbnail(survey_id, 5),
        lambda: store.drives.say(survey_id, 5, {"note": "?"}, ""),
        lambda: store.drives.keep(diameter, Kept()),
    ):
        with pytest.raises(NotFound):
            ask()


def test_drives_are_listed_with_diameters_deleted_and_restored(store: Store) -> None:
    diameter = saved(store)
    survey_id = driven(store, landmark(1))
    assert [row["id"] for row in store.surveys.summaries(None, 10, None)] == [diameter]  # not while it is under way
    store.drives.keep(survey_id, Kept(summary={"landmarks": 1, "from_m": 0.0, "to_m": 4.0}), state="saved")
    listed = store.surveys.summaries(None, 10, None)
    assert [(row["id"], row["kind"]) for row in listed] == [(survey_id, "landmarks"), (diameter, "diameter")]
    assert (listed[0]["landmarks"], listed[0]["to_m"], listed[0]["final_verdict"]) == (1, 4.0, None)
    assert store.surveys.get(survey_id)["final_verdict"] is None
    store.surveys.delete(survey_id)
    with pytest.raises(NotFound):
        store.drives.map(survey_id)
    store.surveys.restore(survey_id)
    assert store.drives.map(survey_id)["landmarks"][0]["id"] == 1


def test_a_cancelled_drive_leaves_nothing(store: Store) -> None:
    survey_id = driven(store, landmark(1))
    store.drives.keep(survey_id, Kept(log=[1], faults=[{"what": "x"}]))
    store.drives.say(survey_id, 1, {"note": "n"}, "")
    store.drives.forget(survey_id)
    with store._database.read() as connection:
        for table in ("surveys", "drives", "landmarks", "landmark_words", "drive_faults", "drive_log"):
            assert connection.execute(f"SELECT count(*) FROM {table}").fetchone()[0] == 0, table


def test_a_drive_that_was_cut_off_is_kept_as_interrupted(tmp_path: Path, clock: SteeredClock) -> None:
    program = f"""
import os, signal
from pathlib import Path
from tests.unit.device.test_store import SteeredClock
from tests.unit.device.test_store_drives import driven, landmark
from device.store import Kept, Store
store = Store(Path({str(tmp_path)!r}), SteeredClock(Path("/nowhere")))
survey_id = driven(store, landmark(1))
store.drives.keep(survey_id, Kept(log=[[1, 0.04]], summary={{"to_m": 3.3}}))
store.drives.begin(None, {{}})
with store._database.write() as connection:
    connection.execute("DELETE FROM landmarks")
    os.kill(os.getpid(), signal.SIGKILL)
"""
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    store = Store(tmp_path, clock)
    assert store.surveys.abandon_unfinished() == 0  # which is for measurements
    assert store.drives.interrupt_unfinished() == 1  # the second drive had seen nothing yet
    found = store.drives.map(1)
    assert (found["state"], found["to_m"], [row["id"] for row in found["landmarks"]]) == ("interrupted", 3.3, [1])
    assert store.drives.log(1) == [[1, 0.04]]
    assert [row["state"] for row in store.surveys.summaries(None, 10, None)] == ["interrupted"]
    assert os.path.exists(tmp_path / "borescout.db")


def test_settings_from_the_page_outlive_a_restart(store: Store, tmp_path: Path, clock: SteeredClock) -> None:
    assert store.remembered.get("encoder") == {}
    store.remembered.put("encoder", {"counts_per_metre": 1000.0})
    store.remembered.put("encoder", {"counts_per_metre": 998.5, "direction": -1})
    store.close()
    again = Store(tmp_path / "data", clock)
    assert again.remembered.get("encoder") == {"counts_per_metre": 998.5, "direction": -1}
