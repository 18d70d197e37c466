"""The label of the box: its codes are read back as a phone would."""

from __future__ import annotations

import io
import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from device.cli import _run
from device.errors import Invalid
from device.label import Label


def decoded(svg: str) -> str:
    """What a camera reads from an inline SVG of segno: its one path drawn as pixels."""
    size = int(re.search(r'viewBox="0 0 (\d+) ', svg)[1])  # type: ignore[index]
    picture = np.full((size, size), 255, np.uint8)
    x = y = 0.0
    for command, rest in re.findall(r"([Mmh])([-\d. ]+)", re.search(r'stroke="#000" d="([^"]+)"', svg)[1]):  # type: ignore[index]
        numbers = [float(number) for number in re.findall(r"-?\d+\.?\d*", rest)]
        if command == "M":
            x, y = numbers
        elif command == "m":
            x, y = x + numbers[0], y + numbers[1]
        else:
            picture[int(y), int(x) : int(x + numbers[0])] = 0
            x += numbers[0]
    large = cv2.resize(picture, None, fx=8, fy=8, interpolation=cv2.INTER_NEAREST)
    return cv2.QRCodeDetector().detectAndDecode(large)[0]


@pytest.mark.parametrize("key", ["k7mp2xqz9fhd", 'odd;:\\"key'])
def test_the_codes_join_the_network_and_open_the_page(key: str) -> None:
    page = Label("borescout-7f3a", key, "http://10.42.0.1/", "123456").page()
    codes = [decoded(svg) for svg in re.findall(r"<svg.*?</svg>", page, re.DOTALL)]
    escaped = re.sub(r'([;:\\"])', r"\\\1", key)
    assert codes[0].startswith("WIFI:T:WPA;S:borescout-7f3a;")
    assert f"P:{escaped};" in codes[0]
    assert codes[1] == "http://10.42.0.1/"
    assert "123456" in page
    assert "http://" not in page.replace("http://10.42.0.1/", "").replace("http://www.w3.org/", ""), "nothing from elsewhere"


@pytest.mark.parametrize(("ssid", "key"), [("", "long enough"), ("x" * 33, "long enough"), ("box", "short"), ("box", "k" * 64)])
def test_what_no_network_can_be_called_is_refused(ssid: str, key: str) -> None:
    with pytest.raises(Invalid):
        Label(ssid, key, "http://10.42.0.1/", "123456")


def test_the_command_writes_a_page_for_the_owner_alone(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    key, out, data = tmp_path / "key", tmp_path / "label.html", tmp_path / "data"
    key.write_text("k7mp2xqz9fhd\n")
    given = ["label", "--ssid", "borescout-7f3a", "--key-file", str(key), "--data-dir", str(data)]
    assert _run([*given, "--out", str(out)]) == 0
    assert out.stat().st_mode & 0o077 == 0
    assert (data / "pin").read_text().strip() in out.read_text()
    assert _run(given) == 0
    assert capsys.readouterr().out == out.read_text() + "\n"
    assert _run(["label", "--ssid", "b", "--key-file", str(tmp_path / "none")]) == 2
    assert io.StringIO(capsys.readouterr().err).readline().startswith("borescout: The key of the Wi-Fi cannot be read")
