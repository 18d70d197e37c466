"""The store: what is shown as saved is on the disk, whatever happens next."""

from __future__ import annotations

import json
import os
import signal
import sqlite3
import subprocess
import sys
import threading
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from device.clock import Clock
from device.errors import Invalid, NotFound, StorageFull, StoreUnusable
from device.store import NewRecording, Store
from device.store import database as database_module
from device.store.database import FILE_NAME, migrations

MAY_2026_MS = 1_777_600_000_000


class SteeredClock(Clock):
    """A clock that shows what a test sets, from the browser."""

    def __init__(self, root: Path) -> None:
        self.ns = 10**9
        super().__init__(root, lambda: self.ns, lambda: 0)


@pytest.fixture
def clock(tmp_path: Path) -> SteeredClock:
    return SteeredClock(tmp_path / "no-machine")


@pytest.fixture
def store(tmp_path: Path, clock: SteeredClock) -> Store:
    return Store(tmp_path / "data", clock)


def result(diameter_mm: float | None = 400.0, verdict: str = "accept", **more: Any) -> dict[str, Any]:
    prompts = [] if verdict == "accept" else [{"code": "aim", "reason": "It looks aside.", "remedy": "Turn it."}]
    return {
        "verdict": verdict,
        "reasons": [prompt["code"] for prompt in prompts],
        "prompts": prompts,
        "diameter_mm": diameter_mm,
        "interval_mm": [398.0, 402.0],
        "dn": {"name": "DN 400", "probability": 0.98, "alternatives": []},
        "camera": "realsense",
        "position": "entrance",
        **more,
    }


def recording(found: dict[str, Any], cloud: dict[str, Any] | None = None) -> NewRecording:
    return NewRecording(found["camera"], found["position"], 50, found, cloud, {"width": 848})


def saved(store: Store, pipe_id: int | None = None, found: dict[str, Any] | None = None, cloud: Any = None) -> int:
    found = found or result()
    survey_id = store.surveys.begin("diameter", pipe_id)
    store.surveys.conclude(survey_id, "saved", [recording(found, cloud)], found)
    return survey_id


# --- places ---


def test_manholes_and_pipes(store: Store) -> None:
    start, end = store.places.create_node("S1"), store.places.create_node(" S2 ")
    assert [node["name"] for node in store.places.nodes()] == ["S1", "S2"]
    pipe = store.places.create_pipe({"name": "H1", "start_node": start["id"], "end_node": end["id"], "material": "PVC"})
    assert pipe == store.places.pipe(pipe["id"])
    changed = store.places.update_pipe(pipe["id"], {"reference_dn": 400})
    assert changed == {**pipe, "reference_dn": 400}
    store.places.delete_pipe(pipe["id"])
    assert store.places.pipes() == []
    with pytest.raises(NotFound):
        store.places.update_pipe(pipe["id"], {"note": "gone"})


@pytest.mark.parametrize(
    ("data", "sentence"),
    [
        ({}, "The field name is missing."),
        ({"name": "  "}, "it must not be empty"),
        ({"name": "x" * 81}, "80 characters"),
        ({"name": "H1", "material": "gold"}, "material"),
        ({"name": "H1", "reference_dn": 5}, "reference_dn"),
        ({"name": "H1", "colour": "red"}, "There is no field called colour."),
        ({"name": "H1", "start_node": 77}, "a manhole that does not exist"),
    ],
)
def test_a_bad_pipe_is_refused_in_one_sentence(store: Store, data: dict[str, Any], sentence: str) -> None:
    with pytest.raises(Invalid) as told:
        store.places.create_pipe(data)
    assert sentence in str(told.value)
    assert store.places.pipes() == []


def test_two_manholes_cannot_share_a_name(store: Store) -> None:
    store.places.create_node("S1")
    with pytest.raises(Invalid, match="already a manhole called S1"):
        store.places.create_node("S1")


def test_two_pipes_cannot_share_a_name_but_a_deleted_one_frees_it(store: Store) -> None:
    first = store.places.create_pipe({"name": "H1"})
    with pytest.raises(Invalid, match="already a pipe called H1"):
        store.places.create_pipe({"name": " H1 "})
    other = store.places.create_pipe({"name": "H2"})
    with pytest.raises(Invalid, match="already a pipe called H1"):
        store.places.update_pipe(other["id"], {"name": "H1"})
    assert store.places.update_pipe(first["id"], {"name": "H1", "note": "again"})["note"] == "again"
    store.places.delete_pipe(first["id"])
    assert store.places.restore_pipe(first["id"])["note"] == "again"
    store.places.delete_pipe(first["id"])
    store.places.create_pipe({"name": "H1"})
    with pytest.raises(Invalid, match="already a pipe called H1"):
        store.places.restore_pipe(first["id"])
    with pytest.raises(NotFound):
        store.places.restore_pipe(77)


def test_a_pipe_joins_two_manholes(store: Store) -> None:
    node = store.places.create_node("S1")["id"]
    with pytest.raises(Invalid, match="The pipe H1 would begin and end at the same manhole"):
        store.places.create_pipe({"name": "H1", "start_node": node, "end_node": node})


def test_half_a_place_is_none(store: Store) -> None:
    with pytest.raises(Invalid, match="half a place"):
        store.places.create_node("S1", easting=565000.0)
    node = store.places.create_node("S1", easting=565000.0, northing=5933000.0)
    with pytest.raises(Invalid, match="half a place"):
        store.places.update_node(node["id"], {"northing": None})


def test_coordinates_are_not_given_another_meaning(store: Store) -> None:
    store.places.update_site({"crs": 4326})
    store.places.update_site({"crs": 25832})
    node = store.places.create_node("S1", easting=565000.0, northing=5933000.0)
    with pytest.raises(Invalid, match="EPSG:25832"):
        store.places.update_site({"crs": 25833})
    assert store.places.update_site({"name": "Hafencity"}) == {"id": 1, "name": "Hafencity", "crs": 25832}
    store.places.update_node(node["id"], {"easting": None, "northing": None})
    assert store.places.update_site({"crs": 25833})["crs"] == 25833


def test_a_manhole_is_forgotten_only_where_nothing_refers_to_it(store: Store) -> None:
    used, free = store.places.create_node("S1"), store.places.create_node("S2")
    store.places.create_pipe({"name": "H1", "start_node": used["id"]})
    with pytest.raises(Invalid, match="S1 stays"):
        store.places.delete_node(used["id"])
    store.places.delete_node(free["id"])
    assert [node["name"] for node in store.places.nodes()] == ["S1"]
    with pytest.raises(NotFound):
        store.places.delete_node(free["id"])


def test_names_are_judged_beside_all_others(store: Store) -> None:
    nodes = [store.places.create_node(name)["id"] for name in ("S1", "S2")]
    pipe = store.places.create_pipe({"name": "S1-S2", "start_node": nodes[0], "end_node": nodes[1]})
    assert store.places.judge_pipe("", "S1", "S2")["error"] == "There is already a pipe called S1-S2."
    assert store.places.judge_pipe("", "S1", "S2", pipe["id"]) == {"name": "S1-S2", "error": None, "warnings": ()}
    assert store.places.judge_node("S2")["error"] == "There is already a manhole called S2."
    assert store.places.judge_node("S2", nodes[1])["error"] is None


# --- surveys ---


def test_a_survey_comes_back_as_it_was_saved(store: Store) -> None:
    pipe = store.places.create_pipe({"name": "H1"})
    cloud = {"points": [[0.1, 0.2, 0.3]], "inlier": [1], "cylinder": None}
    found = result(radius_std_mm=float("nan"))
    survey_id = saved(store, pipe["id"], found, cloud)
    survey = store.surveys.get(survey_id)
    assert survey["pipe"] == pipe
    assert survey["result"] == {**found, "radius_std_mm": None}  # JSON has no word for NaN
    assert survey["recordings"][0]["result"]["diameter_mm"] == 400.0
    assert (survey["state"], survey["final_verdict"], survey["verdict_by"]) == ("saved", "accept", "device")
    assert store.surveys.cloud(survey_id) == cloud


def test_the_cloud_is_that_of_the_chosen_recording(store: Store) -> None:
    first, second = result(position="entrance"), result(position="middle")
    survey_id = saved(store, found=first, cloud={"points": [[1, 1, 1]]})
    store.surveys.conclude(survey_id, "saved", [recording(second, {"points": [[2, 2, 2]]})], first)
    cloud = store.surveys.cloud(survey_id)
    assert cloud == {"points": [[1, 1, 1]]}
    assert len(store.surveys.get(survey_id)["recordings"]) == 2


def with_pictures(found: dict[str, Any], color: bytes | None, depth: bytes | None) -> NewRecording:
    return replace(recording(found), picture_color=color, picture_depth=depth)


def test_the_pictures_are_those_of_the_chosen_recording_and_of_no_other(store: Store) -> None:
    first, second, third = result(401.0), result(402.0), result(403.0, position="middle")
    survey_id = store.surveys.begin("diameter", None)
    recordings = [with_pictures(first, b"first", b"deep"), with_pictures(second, b"second", None), recording(third)]
    shown = []
    for chosen in (first, {**second, "verdict": "retry", "prompts": []}, third):  # a conclusion may refuse what it chose
        store.surveys.conclude(survey_id, "saved", recordings, chosen)
        recordings = []
        shown.append([store.surveys.picture(survey_id, kind) for kind in ("color", "depth")])
    assert shown == [[b"first", b"deep"], [b"second", None], [None, None]]


def test_pictures_go_with_their_survey(store: Store, clock: SteeredClock) -> None:
    clock.offer(MAY_2026_MS)
    survey_id = store.surveys.begin("diameter", None)
    store.surveys.conclude(survey_id, "saved", [with_pictures(result(), b"color", b"depth")], result())
    store.surveys.delete(survey_id)
    with pytest.raises(NotFound):
        store.surveys.picture(survey_id, "color")
    store.surveys.restore(survey_id)
    assert store.surveys.picture(survey_id, "color") == b"color"
    store.surveys.delete(survey_id)
    clock.ns += 31 * 86_400 * 10**9
    assert len(store.surveys.purge(30)) == 1
    with store._database.read() as connection:
        assert connection.execute("SELECT count(*) FROM findings").fetchone()[0] == 0
    with pytest.raises(NotFound):
        store.surveys.picture(survey_id, "color")


def test_history_is_newest_first_in_pages_and_by_pipe(store: Store) -> None:
    pipe = store.places.create_pipe({"name": "H1"})
    numbers = [saved(store, pipe["id"] if n % 2 else None) for n in range(6)]
    page = store.surveys.summaries(None, 4, None)
    assert [row["id"] for row in page] == numbers[:1:-1]
    assert [row["id"] for row in store.surveys.summaries(None, 4, page[-1]["id"])] == numbers[1::-1]
    assert [row["id"] for row in store.surveys.summaries(pipe["id"], 50, None)] == [numbers[5], numbers[3], numbers[1]]
    assert page[0]["dn"]["name"] == "DN 400"
    assert page[0]["pipe"] == "H1"


def test_a_measurement_that_is_under_way_is_not_in_the_history(store: Store) -> None:
    store.surveys.begin("diameter", None)
    assert store.surveys.summaries(None, 50, None) == []


def test_the_operator_can_refuse_what_the_device_accepts_and_it_is_kept_who_said_what(store: Store) -> None:
    survey_id = saved(store)
    store.surveys.answer(survey_id, {"image_good": True, "verdict": "accept"}, "Ada", "")
    store.surveys.answer(survey_id, {"fit_aligned": False, "verdict": "retry"}, "Bob", "cylinder is beside it")
    survey = store.surveys.get(survey_id)
    assert survey["operator"]["answers"] == {"image_good": True, "cloud_is_pipe": None, "fit_aligned": False}
    assert (survey["final_verdict"], survey["verdict_by"], survey["operator"]["by"]) == ("retry", "operator", "Bob")
    assert [said["by"] for said in survey["operator"]["history"]] == ["Ada", "Bob"]
    assert store.surveys.summaries(None, 1, None)[0]["final_verdict"] == "retry"


def test_an_answer_to_the_first_position_says_nothing_of_the_second(store: Store) -> None:
    survey_id = saved(store, found=result(verdict="retry"))
    store.surveys.answer(survey_id, {"verdict": "retry"}, "Ada", "")
    better = result(position="middle")
    store.surveys.conclude(survey_id, "saved", [recording(better)], better)
    survey = store.surveys.get(survey_id)
    assert survey["final_verdict"] == "accept"
    assert survey["operator"]["verdict"] is None
    assert survey["operator"]["history"][0]["verdict"] == "retry"


def test_the_operator_cannot_accept_what_the_device_refuses(store: Store) -> None:
    survey_id = saved(store, found=result(verdict="retry"))
    store.surveys.answer(survey_id, {"verdict": "accept"}, "Ada", "")
    assert store.surveys.get(survey_id)["final_verdict"] == "retry"


def test_delete_undo_and_purge(store: Store, clock: SteeredClock) -> None:
    clock.offer(MAY_2026_MS)
    kept, gone = saved(store), saved(store)
    store.surveys.delete(gone)
    assert [row["id"] for row in store.surveys.summaries(None, 50, None)] == [kept]
    with pytest.raises(NotFound):
        store.surveys.get(gone)
    with pytest.raises(NotFound):
        store.surveys.delete(gone)
    store.surveys.restore(gone)
    assert store.surveys.get(gone)["id"] == gone
    store.surveys.delete(gone)
    clock.ns += 29 * 86_400 * 10**9
    assert len(store.surveys.purge(30)) == 0
    clock.ns += 2 * 86_400 * 10**9
    assert len(store.surveys.purge(30)) == 1
    with pytest.raises(NotFound):
        store.surveys.restore(gone)
    assert saved(store) > gone  # a number is never used twice


def test_nothing_is_purged_while_the_date_is_unknown(store: Store) -> None:
    store.surveys.delete(saved(store))
    assert len(store.surveys.purge(0)) == 0


def test_what_was_measured_before_the_date_was_known_gets_it_afterwards(store: Store, clock: SteeredClock) -> None:
    survey_id = saved(store)
    assert store.surveys.get(survey_id)["created"] is None
    clock.ns += 60 * 10**9
    clock.offer(MAY_2026_MS)
    store.surveys.date_this_boot()
    survey = store.surveys.get(survey_id)
    assert (survey["created"], survey["clock_source"]) == ("2026-05-01T01:45:40Z", "browser")


def test_a_cancelled_survey_leaves_nothing_and_a_cancelled_second_position_leaves_the_first(store: Store) -> None:
    fresh = store.surveys.begin("diameter", None)
    store.surveys.abandon(fresh)
    with pytest.raises(NotFound):
        store.surveys.get(fresh)
    survey_id = saved(store)
    store.surveys.reopen(survey_id)
    assert store.surveys.abandon_unfinished() == 1
    assert store.surveys.get(survey_id)["state"] == "saved"


def test_a_conclusion_that_cannot_be_written_leaves_the_old_one(store: Store) -> None:
    survey_id = saved(store)
    broken = result(prompts=[{"code": "aim", "reason": None, "remedy": "x"}])  # NOT NULL, found after the rest was written
    with pytest.raises(sqlite3.IntegrityError):
        store.surveys.conclude(survey_id, "saved", [recording(result(333.0))], broken)
    survey = store.surveys.get(survey_id)
    assert len(survey["recordings"]) == 1
    assert survey["result"]["diameter_mm"] == 400.0


def test_many_threads_may_write_at_once(store: Store) -> None:
    threads = [threading.Thread(target=lambda: [saved(store) for _ in range(5)]) for _ in range(6)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(store.surveys.summaries(None, 100, None)) == 30


# --- the file ---


def test_durability_is_asked_for_and_foreign_keys_hold(store: Store) -> None:
    with store._database.read() as connection:
        assert connection.execute("PRAGMA journal_mode").fetchone()[0] == "wal"
        assert connection.execute("PRAGMA synchronous").fetchone()[0] == 2
        assert connection.execute("PRAGMA foreign_keys").fetchone()[0] == 1


def test_what_was_saved_survives_kill_9(tmp_path: Path) -> None:
    program = f"""
import os, signal, sys
from pathlib import Path
from tests.unit.device.test_store import SteeredClock, recording, result
from device.store import Store
store = Store(Path({str(tmp_path)!r}), SteeredClock(Path("/nowhere")))
survey_id = store.surveys.begin("diameter", None)
store.surveys.conclude(survey_id, "saved", [recording(result(123.0))], result(123.0))
store.surveys.begin("diameter", None)
print("saved", survey_id, flush=True)
with store._database.write() as connection:
    connection.execute("UPDATE findings SET body = '{{}}'")
    os.kill(os.getpid(), signal.SIGKILL)
"""
    root = Path(__file__).resolve().parents[3]
    done = subprocess.run([sys.executable, "-c", program], cwd=root, capture_output=True, text=True, check=False)
    assert done.returncode == -signal.SIGKILL, done.stderr
    survey_id = int(done.stdout.split()[1])
    store = Store(tmp_path, SteeredClock(tmp_path / "x"))
    assert store.notice is None
    assert store.surveys.get(survey_id)["result"]["diameter_mm"] == 123.0
    assert store.surveys.abandon_unfinished() == 1  # the one that was cut off


def test_migrations_are_numbered_without_gaps_and_run_once(store: Store, tmp_path: Path, clock: SteeredClock) -> None:
    numbers = [number for number, _ in migrations()]
    assert numbers == list(range(1, len(numbers) + 1))
    survey_id = saved(store)
    store.close()
    again = Store(tmp_path / "data", clock)
    assert again.surveys.get(survey_id)["result"]["diameter_mm"] == 400.0


def test_a_new_migration_is_applied_to_an_old_database(
    store: Store, tmp_path: Path, clock: SteeredClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    survey_id = saved(store)
    store.close()
    steps = [*migrations(), (len(migrations()) + 1, "ALTER TABLE pipes ADD COLUMN slope REAL;")]
    monkeypatch.setattr(database_module, "migrations", lambda: steps)
    newer = Store(tmp_path / "data", clock)
    assert newer.surveys.get(survey_id)["id"] == survey_id
    with newer._database.read() as connection:
        assert connection.execute("SELECT slope FROM pipes").fetchall() == []


def test_a_database_from_before_the_pictures_keeps_its_findings_and_takes_pictures(tmp_path: Path, clock: SteeredClock) -> None:
    (tmp_path / "data").mkdir()
    old = sqlite3.connect(tmp_path / "data" / FILE_NAME)
    old.executescript(migrations()[0][1])
    old.execute("PRAGMA user_version = 1")
    old.execute("INSERT INTO surveys (id, kind, state, clock_source, boot_id, monotonic_ns) VALUES (7, '', 'saved', '', '', 0)")
    old.execute("INSERT INTO recordings (id, survey_id, camera, position, frames) VALUES (3, 7, 'realsense', 'entrance', 50)")
    body, cloud = json.dumps(result()), zlib.compress(b'{"points": [[1, 1, 1]]}')
    for number, points in ((3, cloud), (None, None)):
        old.execute(
            "INSERT INTO findings (survey_id, recording_id, kind, body, cloud) VALUES (7, ?, '', ?, ?)", (number, body, points)
        )
    old.commit()
    old.close()
    store = Store(tmp_path / "data", clock)
    assert store.surveys.get(7)["result"]["diameter_mm"] == 400.0
    assert store.surveys.cloud(7) == {"points": [[1, 1, 1]]}
    assert store.surveys.picture(7, "color") is None
    better = result(401.0, position="middle")
    store.surveys.conclude(7, "saved", [with_pictures(better, b"color", b"depth")], better)
    assert [store.surveys.picture(7, kind) for kind in ("color", "depth")] == [b"color", b"depth"]


def test_a_migration_that_fails_leaves_the_database_as_it_was(
    store: Store, tmp_path: Path, clock: SteeredClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    survey_id = saved(store)
    store.close()
    with monkeypatch.context() as patch:
        steps = [*migrations(), (len(migrations()) + 1, "ALTER TABLE pipes ADD COLUMN x REAL; SELECT * FROM nowhere;")]
        patch.setattr(database_module, "migrations", lambda: steps)
        with pytest.raises(StoreUnusable, match="nowhere"):
            Store(tmp_path / "data", clock)
    again = Store(tmp_path / "data", clock)
    assert again.surveys.get(survey_id)["id"] == survey_id
    with again._database.read() as connection:
        assert "x" not in connection.execute("SELECT * FROM pipes").description


def test_a_database_of_a_newer_program_is_refused_and_not_touched(store: Store, tmp_path: Path, clock: SteeredClock) -> None:
    store.close()
    file = tmp_path / "data" / FILE_NAME
    with sqlite3.connect(file) as connection:
        connection.execute("PRAGMA user_version = 99")
    connection.close()
    with pytest.raises(StoreUnusable, match=r"newer borescout \(schema 99, this one knows"):
        Store(tmp_path / "data", clock)
    assert [path.name for path in file.parent.glob("*damaged*")] == []


@pytest.mark.parametrize("damage", ["garbage", "torn page"])
def test_a_damaged_database_is_set_aside_and_reported(store: Store, tmp_path: Path, clock: SteeredClock, damage: str) -> None:
    for _ in range(40):
        saved(store)
    store.close()
    file = tmp_path / "data" / FILE_NAME
    content = bytearray(file.read_bytes())
    if damage == "garbage":
        content[:] = os.urandom(len(content))
    else:
        content[4096 : 4096 * 6] = os.urandom(4096 * 5)
    file.write_bytes(content)
    store = Store(tmp_path / "data", clock)
    assert store.notice is not None
    assert "set aside as borescout.db.damaged-1" in store.notice
    assert (tmp_path / "data" / "borescout.db.damaged-1").read_bytes() == content
    assert saved(store) == 1


def test_a_second_damaged_file_does_not_replace_the_first(tmp_path: Path, clock: SteeredClock) -> None:
    for text in (b"one" * 1000, b"two" * 1000):
        (tmp_path / FILE_NAME).write_bytes(text)
        Store(tmp_path, clock).close()
    assert (tmp_path / "borescout.db.damaged-1").read_bytes().startswith(b"one")
    assert (tmp_path / "borescout.db.damaged-2").read_bytes().startswith(b"two")


def test_a_full_disk_is_told_as_such_and_what_was_there_stays(store: Store) -> None:
    survey_id = saved(store)
    with store._database.read() as connection:
        pages = connection.execute("PRAGMA page_count").fetchone()[0]
        connection.execute(f"PRAGMA max_page_count = {pages + 2}")
    with pytest.raises(StorageFull, match="The disk is full"):
        saved(store, found=result(note="x" * 100_000))
    assert store.surveys.get(survey_id)["result"]["diameter_mm"] == 400.0


def test_a_folder_that_cannot_be_used_is_told_in_one_sentence(tmp_path: Path, clock: SteeredClock) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StoreUnusable, match="cannot be made"):
        Store(tmp_path / "file" / "data", clock)
