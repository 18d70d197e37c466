"""The files of systemd/: as systemd reads them, and as the installer and the program need them of each other."""

from __future__ import annotations

import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import pytest

from device.config import Settings
from web_ui.captive import NO_CONTENT, PROBES

SYSTEMD = Path(__file__).resolve().parents[2] / "systemd"


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed: apt install systemd")
def test_the_units_are_clean_and_the_services_closely_shut() -> None:
    done = subprocess.run(["sh", str(SYSTEMD / "check.sh")], capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    levels = [float(level) for level in re.findall(r"exposure level for \S+: ([\d.]+)", done.stdout)]
    assert len(levels) == len(list(SYSTEMD.glob("*.service")))
    assert max(levels) <= 1.8


@pytest.mark.parametrize("camera", ["realsense", "virtual"])
def test_the_settings_that_the_installer_writes_are_known_to_the_program(camera: str) -> None:
    text = (SYSTEMD / "etc/borescout.toml").read_text()
    crawler = '\n[crawler]\ngrabber = "virtual"\nencoder = "virtual"\n' if camera == "virtual" else ""
    for mark, value in (("@CAMERA@", camera), ("@WIFI@", "wlan0"), ("@HOTSPOT@", "borescout"), ("@CRAWLER@", crawler)):
        assert mark in text
        text = text.replace(mark, value)
    settings = Settings(**tomllib.loads(text))
    assert (settings.host, settings.port, settings.machine.hotspot) == ("0.0.0.0", 80, "borescout")


def installer(*arguments: str) -> subprocess.CompletedProcess[str]:
    """As a user who mistypes; it must not touch anything before it has read its options."""
    return subprocess.run(["sh", str(SYSTEMD / "install.sh"), *arguments], capture_output=True, text=True, timeout=20)


@pytest.mark.parametrize(
    "arguments",
    [
        ("--banana",),
        ("--wheel",),
        ("--camera", "webcam"),
        ("--country", "Germany"),
        ("--wifi", "wlan0; rm -rf /"),
        ("--purge",),
        ("--wheel", "/nowhere/borescout.whl"),
    ],
)
def test_a_slip_is_said_in_one_sentence(arguments: tuple[str, ...]) -> None:
    done = installer(*arguments)
    assert done.returncode == 2
    assert re.search(r"^install: .*\.$", done.stderr, re.MULTILINE)


def test_help_names_every_option() -> None:
    said = installer("--help")
    assert said.returncode == 0
    options = set(re.findall(r"^ {4}(--[a-z-]+)[)|]|\|(--[a-z-]+)", (SYSTEMD / "install.sh").read_text(), re.MULTILINE))
    for option in {one or other for one, other in options} - {"--help"}:
        assert option in said.stdout, option


def test_every_file_that_is_installed_is_there_and_every_other_one_is_used() -> None:
    script = (SYSTEMD / "install.sh").read_text()
    for file in SYSTEMD.rglob("*"):
        if file.is_file() and file.name not in ("install.sh", "check.sh"):
            assert file.name in script, f"{file.name} is never installed"
    for source in re.findall(r'echo "(etc/\S+) /', script):
        assert (SYSTEMD / source).is_file()


def test_phones_on_the_hotspot_are_answered_by_the_box() -> None:
    """Names and address of three files fit together: the hotspot's, its name server's and the page's."""
    address = re.search(r"address1=([\d.]+)/24", (SYSTEMD / "etc/hotspot.nmconnection").read_text())[1]  # type: ignore[index]
    names = dict(re.findall(r"^address=/(\S+)/([\d.]+)$", (SYSTEMD / "etc/dnsmasq.conf").read_text(), re.MULTILINE))
    assert set(names.values()) == {address}
    for host in ("captive.apple.com", "connectivitycheck.gstatic.com", "www.msftconnecttest.com", "detectportal.firefox.com"):
        assert host in names
    assert PROBES
    assert NO_CONTENT
    assert "band=bg" in (SYSTEMD / "etc/hotspot.nmconnection").read_text(), "phones that cannot join 5 GHz"
