"""A log that was cut off or flipped gives back all but what was hit, and nothing goes before the new file has been read."""

from __future__ import annotations

import fcntl
import random
from pathlib import Path

import pytest

from device.recorder import Shelf, recorder, recovery, writer
from device.recorder.reader import open_recording
from device.recorder.recovery import CannotRecover, check, recover
from device.recorder.samples import Picture
from drivers.encoder.base import Reading
from tests.unit.device.recorder_samples import cctv, reading, recording

PICTURES = 12


@pytest.fixture(autouse=True)
def small_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Each picture fills a chunk; the reading before it shares it."""
    monkeypatch.setattr(writer, "CHUNK_BYTES", 20_000)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(writer, "CHUNK_BYTES", 20_000)
        patch.setattr(recorder, "SYNC_S", 1000.0)  # chunks end where they are full, however slow the machine is
        return recording(tmp_path_factory.mktemp("whole"), PICTURES).read_bytes()


def chunks_in(data: bytes) -> list[int]:
    """Where they begin."""
    found, at = [], -1
    while (at := data.find(b"\x04\x00\x00\x00zstd", at + 1)) >= 0:
        if at >= 37 and data[at - 37] == 6:
            found.append(at - 37)
    return found


def numbers(path: Path) -> list[int]:
    return [entry.sample.number for entry in open_recording(path).entries() if isinstance(entry.sample, Picture)]


def test_a_whole_file_is_left_as_it_is(tmp_path: Path, whole: bytes) -> None:
    path = tmp_path / "survey-000007-01-001.mcap"
    path.write_bytes(whole)
    report = recover(path)
    assert (report.ok, report.recovered, report.lost_seconds, report.state) == (True, False, 0.0, "whole")
    assert path.read_bytes() == whole


def test_a_cut_costs_what_was_behind_it_and_half_a_chunk(tmp_path: Path, whole: bytes) -> None:
    path = tmp_path / "survey-000007-01-001.mcap"
    begins = chunks_in(whole)
    assert len(begins) == PICTURES + 1  # the last reading
    chance = random.Random(1)
    for size in [0, 1, 8, 9, len(whole) - 1, *(chance.randrange(len(whole)) for _ in range(40))]:
        path.write_bytes(whole[:size])
        tried = check(path)
        assert (tried.ok, tried.recovered) == (False, True)
        assert path.stat().st_size == size
        report = recover(path)
        assert report.ok
        assert report.recovered
        assert check(path) == report
        pictures = sum(after <= size for after in begins[1:])
        assert report.messages == 3 * pictures or size > begins[-1]
        assert pictures == 0 or numbers(path) == list(range(pictures))
        assert report.lost_seconds < 1.0


def test_a_flipped_bit_costs_one_chunk(tmp_path: Path, whole: bytes) -> None:
    path = tmp_path / "survey-000007-01-001.mcap"
    chance = random.Random(2)
    soft = [at + k for begin in chunks_in(whole)[1:3] for at in (begin - 60, begin) for k in range(0, 60, 4)]
    for at in [*soft, *(chance.randrange(len(whole)) for _ in range(30))]:  # headers and indexes, and anywhere
        data = bytearray(whole)
        data[at] ^= 1 << chance.randrange(8)
        path.write_bytes(data)
        assert not check(path, try_recovery=False).ok
        assert recover(path).ok
        got = numbers(path)
        assert len(got) >= PICTURES - 1
        assert sorted(set(got)) == got
        readings = [entry.sample for entry in open_recording(path).entries() if isinstance(entry.sample, Reading)]
        assert len(readings) >= PICTURES - 1
        assert open_recording(path).head["survey_id"] == 7


@pytest.mark.parametrize("what", ["first chunk", "every chunk but one", "head", "index"])
def test_where_it_hurts_most(tmp_path: Path, whole: bytes, what: str) -> None:
    data = bytearray(whole)
    if what == "first chunk":
        data[chunks_in(whole)[0] + 200] ^= 1  # it holds the definitions
    elif what == "every chunk but one":
        for begin in chunks_in(whole)[1:]:  # the last reading has one of its own
            data[begin + 200] ^= 1
    elif what == "head":
        data[data.index(b"landmarks")] ^= 1
    else:
        data[-100] ^= 1
    path = tmp_path / "survey-000007-01-001.mcap"
    path.write_bytes(data)
    recover(path)
    got = numbers(path)
    expected = {"first chunk": PICTURES - 1, "every chunk but one": 1, "head": PICTURES, "index": PICTURES}[what]
    assert len(got) == expected
    assert open_recording(path).head["kind"] == "landmarks"
    assert (check(path).lost_seconds > 0) == (what == "every chunk but one")  # before the first there is nothing to count from


def test_a_recovered_file_can_be_damaged_and_recovered_again(tmp_path: Path, whole: bytes) -> None:
    path = tmp_path / "survey-000007-01-001.mcap"
    path.write_bytes(whole[: len(whole) // 2])
    first = recover(path)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    second = recover(path)
    assert second.ok
    assert 0 < second.messages < first.messages
    assert numbers(path) == list(range(len(numbers(path))))


def test_the_old_file_stays_where_the_new_one_does_not_read_back(
    tmp_path: Path, whole: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "survey-000007-01-001.mcap"
    torn = whole[: len(whole) // 2]
    path.write_bytes(torn)
    monkeypatch.setattr(recovery, "_opens", lambda path, messages: False)
    with pytest.raises(CannotRecover, match="does not read back"):
        recover(path)
    assert path.read_bytes() == torn
    assert [file.name for file in tmp_path.iterdir()] == [path.name]
    assert not check(path).recovered


def test_garbage_is_left_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "survey-000007-01-001.mcap"
    path.write_bytes(bytes(200_000))
    assert check(path).state == "unreadable"
    assert (check(path).ok, check(path).recovered) == (False, False)
    with pytest.raises(CannotRecover, match="Nothing in"):
        recover(path)
    assert path.read_bytes() == bytes(200_000)


def test_a_file_that_was_only_just_begun_has_lost_nothing(tmp_path: Path) -> None:
    path = tmp_path / "survey-000007-01-001.mcap"
    path.write_bytes(b"")
    report = recover(path)
    assert (report.ok, report.messages, report.lost_seconds) == (True, 0, 0.0)


def test_a_file_that_is_being_written_is_not_touched(tmp_path: Path, whole: bytes) -> None:
    path = tmp_path / "survey-000007-01-001.mcap"
    path.write_bytes(whole[:5000])
    with path.open("rb") as writer:
        fcntl.flock(writer, fcntl.LOCK_EX)
        assert check(path).state == "writing"
        with pytest.raises(CannotRecover, match="in use"):
            recover(path)
    assert check(path).state == "torn"


def test_the_shelf_recovers_what_was_cut_off_and_only_that(tmp_path: Path, whole: bytes) -> None:
    good, torn = tmp_path / "survey-000007-01-001.mcap", tmp_path / "survey-000008-01-001.mcap"
    good.write_bytes(whole)
    torn.write_bytes(whole[: len(whole) - 10_000])
    (tmp_path / "survey-000006-01-001.mcap.recovering").write_bytes(b"left over")
    shelf = Shelf(tmp_path)
    assert [report.file for report in shelf.recover_all()] == [torn.name]
    assert good.read_bytes() == whole
    assert check(torn).ok
    assert shelf.status()["recovered"] == 1
    assert sorted(file.name for file in tmp_path.iterdir()) == [good.name, torn.name]
    assert shelf.recover_all() == []


def test_samples_are_what_they_were_after_a_recovery(tmp_path: Path, whole: bytes) -> None:
    path = tmp_path / "survey-000007-01-001.mcap"
    path.write_bytes(whole[: len(whole) * 2 // 3])
    recover(path)
    for entry in open_recording(path).entries():
        if isinstance(entry.sample, Picture):
            assert entry.sample == cctv(entry.sample.number, (240, 320))
        elif isinstance(entry.sample, Reading):
            assert entry.sample == reading(entry.sequence)
