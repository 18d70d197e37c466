"""A computer made of files: what the box reads below its root, and helper programs that say what a test wants."""

from __future__ import annotations

from pathlib import Path

from device.config import MachineSettings

RADIO = """Interface wlan0
	ifindex 3
	addr dc:a6:32:00:00:01
	ssid borescout-7f3a
	type AP
	channel 6 (2437 MHz), width: 20 MHz, center1: 2437 MHz
"""
STATIONS = """Station 5a:11:22:33:44:55 (on wlan0)
	inactive time:	120 ms
	rx bytes:	12345
Station 5a:11:22:33:44:66 (on wlan0)
	inactive time:	8 ms
"""


class FakeMachine:
    """A Raspberry Pi in good health until a test says otherwise."""

    def __init__(self, folder: Path, hotspot: str = "borescout") -> None:
        self.root = folder / "root"
        self.programs = folder / "bin"
        self.programs.mkdir(parents=True)
        self.temperature("48312")
        self.write("proc/meminfo", "MemTotal: 3884404 kB\nMemFree: 100000 kB\nMemAvailable: 2800000 kB\n")
        self.write("sys/class/rtc/rtc0/since_epoch", "1790000000\n")
        self.says("vcgencmd", "throttled=0x0")
        self.says("iw", RADIO, when={"station": STATIONS})
        self.says("nmcli", "lo:lo\nborescout:wlan0")
        self.settings = MachineSettings(
            root=self.root,
            vcgencmd=str(self.programs / "vcgencmd"),
            iw=str(self.programs / "iw"),
            nmcli=str(self.programs / "nmcli"),
            hotspot=hotspot,
        )

    def write(self, path: str, text: str) -> None:
        file = self.root / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)

    def temperature(self, millidegrees: str) -> None:
        self.write("sys/class/thermal/thermal_zone0/temp", f"{millidegrees}\n")

    def usb(self, port: str, maker: str, product: str, speed: str, *interface_classes: str) -> None:
        folder = f"sys/bus/usb/devices/{port}"
        for name, text in (("idVendor", maker), ("idProduct", "0b07"), ("product", product), ("speed", speed)):
            self.write(f"{folder}/{name}", text)
        for number, kind in enumerate(interface_classes):
            self.write(f"{folder}:1.{number}/bInterfaceClass", kind)

    def says(
        self, program: str, text: str, when: dict[str, str] | None = None, fails: bool = False, takes_s: float = 0
    ) -> None:
        """``when``: what it says instead where a word is among its arguments. Every call is kept, see ``calls``."""
        lines = ["#!/bin/sh", f"echo \"$(basename $0) $*\" >>'{self.programs}/calls'", f"sleep {takes_s}"]
        for word, said in (when or {}).items():
            lines += [f"case \" $* \" in *' {word} '*)", f"cat <<'X'\n{said}\nX", "exit 0;; esac"]
        lines += [f"cat <<'X'\n{text}\nX", f"exit {int(fails)}"]
        script = "\n".join(lines) + "\n"
        file = self.programs / program
        file.write_text(script)
        file.chmod(0o755)

    def without(self, program: str) -> None:
        (self.programs / program).unlink()

    @property
    def calls(self) -> list[str]:
        file = self.programs / "calls"
        return file.read_text().splitlines() if file.exists() else []
