"""Asking the computer how it is: files below the root of its settings, and three helper programs. Nothing here ever raises."""

from __future__ import annotations

import logging
import re
import subprocess
from dataclasses import replace
from pathlib import Path

from device.config import MachineSettings
from device.health.readings import HotspotState, Machine, Power, UsbCamera, power

log = logging.getLogger(__name__)

_PATIENCE_S = 3.0
_USB_MAKERS = {"8086": True, "03e7": True}
"""Makers of depth cameras on USB 3: Intel (RealSense), Movidius (OAK)."""
_STATION = re.compile(r"^Station ([0-9a-f:]{17})", re.MULTILINE)


class MachineReader:
    """One computer. ``read`` takes some tens of milliseconds: it starts programs."""

    def __init__(self, settings: MachineSettings) -> None:
        self._settings = settings
        self._root = settings.root
        self._missing: set[str] = set()

    def read(self) -> Machine:
        """Everything that can be had at this moment."""
        hotspot = self.hotspot()
        clients = self._clients() if hotspot in ("up", "silent") else None
        return replace(self.quick(), power=self._power(), hotspot=hotspot, wifi_clients=clients)

    def quick(self) -> Machine:
        """What can be had without starting a program."""
        return Machine(temperature_c=self._temperature(), memory_free_mb=self._memory(), usb=self._usb())

    def hotspot(self) -> HotspotState:
        """Whether phones can see the hotspot: NetworkManager says that it runs *and* the radio sends a beacon.

        A radio that serves an access point has the type AP, a name and a channel; when its firmware hangs, or another program
        takes it, NetworkManager's process and its word for it live on while the channel is gone.
        """
        if not self._settings.hotspot:
            return "unknown"
        active = self.run(self._settings.nmcli, "-t", "-f", "NAME,DEVICE", "connection", "show", "--active")
        radio = self.run(self._settings.iw, "dev", self._settings.wifi, "info")
        if active is None:
            return "unknown"
        wanted = f"{self._settings.hotspot}:{self._settings.wifi}"
        if wanted not in active.splitlines():
            return "off"
        carrier = self._root / "sys/class/net" / self._settings.wifi / "carrier"
        linked = not carrier.exists() or self._text(carrier) == "1"  # of a link that is down it cannot even be read
        return "up" if linked and radio is not None and beacons(radio) else "silent"

    def restore_hotspot(self) -> None:
        """Down and up again. A radio that hangs needs both: the word "up" alone finds it up already."""
        self.run(self._settings.nmcli, "connection", "down", self._settings.hotspot, patience_s=15.0)
        self.run(self._settings.nmcli, "connection", "up", self._settings.hotspot, patience_s=30.0)

    def run(self, program: str, *arguments: str, patience_s: float = _PATIENCE_S) -> str | None:
        """What the program says, or None where it is not installed, fails or takes too long."""
        try:
            done = subprocess.run(
                [program, *arguments],
                stdin=subprocess.DEVNULL,
                capture_output=True,
                timeout=patience_s,
                text=True,
                errors="replace",
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            if program not in self._missing:
                log.info("%s tells nothing: %s", program, error)
            self._missing.add(program)
            return None
        self._missing.discard(program)
        return done.stdout if done.returncode == 0 else None

    def _temperature(self) -> float | None:
        found = [self._number(zone / "temp") for zone in (self._root / "sys/class/thermal").glob("thermal_zone*")]
        return max((value / 1000 for value in found if value is not None), default=None)

    def _power(self) -> Power | None:
        said = self.run(self._settings.vcgencmd, "get_throttled")
        match = None if said is None else re.search(r"throttled=0x([0-9a-fA-F]+)", said)
        return None if match is None else power(int(match[1], 16))

    def _memory(self) -> int | None:
        said = self._text(self._root / "proc/meminfo") or ""
        match = re.search(r"^MemAvailable:\s+(\d+) kB", said, re.MULTILINE)
        return None if match is None else int(match[1]) * 1024 // 1_000_000

    def _usb(self) -> tuple[UsbCamera, ...]:
        """Depth cameras by their maker and whatever offers a video interface (USB class 14)."""
        devices = self._root / "sys/bus/usb/devices"
        video = {
            interface.name.split(":")[0]
            for interface in devices.glob("*:*")
            if (self._text(interface / "bInterfaceClass") or "") == "0e"
        }
        found = []
        for device in sorted(devices.glob("[0-9]*-*")):
            maker, speed = self._text(device / "idVendor"), self._number(device / "speed")
            if ":" in device.name or speed is None or not (maker in _USB_MAKERS or device.name in video):
                continue
            name = self._text(device / "product") or f"{maker}:{self._text(device / 'idProduct')}"
            found.append(UsbCamera(name, speed, _USB_MAKERS.get(maker or "", False)))
        return tuple(found)

    def _clients(self) -> int | None:
        said = self.run(self._settings.iw, "dev", self._settings.wifi, "station", "dump")
        return None if said is None else len(set(_STATION.findall(said)))

    def _number(self, file: Path) -> float | None:
        try:
            return float(self._text(file) or "")
        except ValueError:
            return None

    @staticmethod
    def _text(file: Path) -> str | None:
        try:
            return file.read_text(encoding="utf-8", errors="replace").strip()
        except OSError:  # a sensor that cannot be read, a device just pulled: there is none
            return None


def beacons(radio: str) -> bool:
    """Whether ``iw dev ... info`` tells of an access point that sends: its type, its name and its channel are all there."""
    return all(re.search(line, radio, re.MULTILINE) for line in (r"^\s*type AP$", r"^\s*ssid \S", r"^\s*channel \d"))
