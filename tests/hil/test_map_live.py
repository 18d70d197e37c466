"""``borescout map --grabber ... --encoder ...``: a stream and a serial line, until Ctrl-C."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import pytest

import device.landmarks.live_command
from device.cli import main
from device.landmarks.pipeline import LandmarkPipeline
from tests.hil.crawler_rig import CAMERA, PipePictures
from tests.unit.drivers.wheel_on_a_pty import PtyRig

FRAMES, STEP_M, SPEED = 60, 0.02, 0.4
LINE = r"D (?P<distance>-?\d+\.\d+)"


class Nobody:
    """A detector that sees nothing."""

    name = "nobody"

    def detect(self, frame: object) -> tuple[()]:
        return ()


@pytest.fixture
def wheel(tmp_path: Path) -> Iterator[PtyRig]:
    begun = time.monotonic()
    rig = PtyRig(tmp_path, lambda _: f"D {5.0 + SPEED * (time.monotonic() - begun):.3f}\r\n".encode(), period_s=0.005)
    rig.encoder = type("Closed", (), {"close": lambda self: None})()
    yield rig
    rig.close()


def stream(folder: Path) -> str:
    """The address of a stream that ends after FRAMES pictures and comes back."""
    writer = cv2.VideoWriter(str(folder / "s.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 25.0, (CAMERA.width, CAMERA.height))
    pictures = PipePictures()
    for k in range(FRAMES):
        writer.write(pictures.at(STEP_M * k))
    writer.release()
    return f"file://{folder / 's.avi'}"


def test_a_drive_until_ctrl_c_is_mapped(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, wheel: PtyRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = LandmarkPipeline.step

    def step(self: LandmarkPipeline, *arguments: Any) -> Any:
        time.sleep(0.03)  # a file is sent as fast as it is read; a crawler is not so fast
        if self.frames == 80:
            raise KeyboardInterrupt
        return seen(self, *arguments)

    monkeypatch.setattr(LandmarkPipeline, "step", step)
    monkeypatch.setattr(device.landmarks.live_command, "shipped_detector", lambda *_, **__: Nobody())
    with pytest.raises(SystemExit) as left:
        main(
            ["map", "--grabber", stream(tmp_path), "--encoder", "pattern", "--port", wheel.wire.port, "--pattern", LINE,
             "--focal", "170", "170", "--radius", "0.15", "--json"]
        )  # fmt: skip
    told = capsys.readouterr()
    assert left.value.code == 0, told.err
    found = json.loads(told.out)
    assert found["frames"] == 80
    assert found["placed"] >= 60
    assert found["from_m"] == pytest.approx(0.0, abs=0.1)  # the drive begins where it was started
    assert 80 * 0.03 * SPEED - 0.3 < found["to_m"] < SPEED * (found["seconds"] + 0.5)
    assert (found["landmarks"], found["focal_radius"]["value"]) == ([], pytest.approx(25.5))
    assert "Mapping; Ctrl-C ends the drive." in told.err
    assert "nothing else is kept" in told.err


def test_an_encoder_that_is_not_there_is_one_sentence(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with pytest.raises(SystemExit) as left:
        main(
            ["map", "--grabber", stream(tmp_path), "--encoder", "nmea", "--port", str(tmp_path / "none"), "--json"]
        )  # fmt: skip
    told = capsys.readouterr()
    assert (left.value.code, told.out) == (2, "")
    lines = [line for line in told.err.splitlines() if line.startswith("borescout: ")]
    assert len(lines) == 1
    assert str(tmp_path / "none") in lines[0]
