"""``borescout measure`` on a camera: the same survey, in a terminal."""

from __future__ import annotations

import io
import json
from collections.abc import Iterator
from pathlib import Path

import click
import pytest

from device.bus import Event, Subscription
from device.diameter import command as measure_command
from device.diameter.command import measure_live
from device.errors import Invalid
from tests.hil.rig import Bench, PipeCamera
from tests.unit.device.device_doubles import ScriptedCamera


class Terminal(io.StringIO):
    """Somebody sits in front of it."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def wide(tmp_path: Path) -> Iterator[Bench]:
    """A box in a pipe that is wide enough for a second position."""
    box = Bench(tmp_path / "data", PipeCamera("front", radius_m=0.2, noise=0.005))
    yield box
    box.close()


def test_json_is_one_result_and_asks_nothing(wide: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    assert measure_live(wide.device, as_json=True) == 0
    said = capsys.readouterr()
    result = json.loads(said.out)
    assert result["survey"] == 1
    assert result["reasons"] == ["second_position"]
    assert "middle of the pipe" in said.err


def test_a_person_is_asked_for_the_second_position(
    wide: Bench, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.stdin", Terminal("y\n"))
    assert measure_live(wide.device, as_json=False) == 0
    said = capsys.readouterr()
    assert "Measure again?" in said.err
    assert "accept" in said.out.splitlines()[-1]
    survey = wide.device.survey(1)
    assert [recording["position"] for recording in survey["recordings"]] == ["entrance", "middle"]


def test_a_person_may_decline(wide: Bench, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", Terminal("n\n"))
    assert measure_live(wide.device, as_json=False) == 0
    assert len(wide.device.survey(1)["recordings"]) == 1
    assert "second_position" in capsys.readouterr().out


def test_ctrl_c_cancels_and_leaves_nothing(wide: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    wide.up()
    patient = Subscription.get

    def interrupted(self: Subscription, timeout_s: float) -> Event | None:
        event = patient(self, timeout_s)
        if event is not None and event.name == "measurement":
            raise KeyboardInterrupt
        return event

    with monkeypatch.context() as patch:
        patch.setattr(Subscription, "get", interrupted)
        with pytest.raises(click.Abort):
            measure_live(wide.device, as_json=False)
    assert wide.finish(1)["state"] == "cancelled"
    assert wide.device.surveys() == []


def test_without_a_camera_it_says_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measure_command, "FIRST_FRAME_S", 1.0)
    box = Bench(tmp_path / "data", ScriptedCamera("frame", missing=10**9))
    try:
        with pytest.raises(Invalid, match="No camera is plugged in"):
            measure_live(box.device, as_json=False)
    finally:
        box.close()
