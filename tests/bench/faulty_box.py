"""A whole virtual box with its page, in a process of its own, whose sensors fail on command.

Run as a program it is the box: it prints its port and takes commands, one JSON object a line, on its standard input. Used as a
class, ``FaultyBox`` starts it, tells it what is to fail, and asks it over HTTP like any other client.
"""

from __future__ import annotations

import contextlib
import http.client
import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil

from tests.pairing import PIN, Pass, pair

SENSORS = ("camera", "grabber", "encoder")
CCTV_FPS = 8.0
"""Drawing 25 pictures a second takes a core: what is looked at here is what goes wrong, not how fast it is."""


class FaultyBox:
    """The box from outside. ``folder`` keeps what it writes, ``live_hz`` are the estimates and ``fps`` the CCTV
    pictures that it makes in a second, the first ``film_s`` seconds of a drive drawn beforehand; such a box has no
    depth camera, which would draw too. To be closed."""

    def __init__(self, folder: Path, live_hz: float = 4.0, fps: float = CCTV_FPS, film_s: float = 0.0) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.log = folder / "log.txt"
        self._log = self.log.open("w")
        self._child = subprocess.Popen(
            [sys.executable, "-m", "tests.bench.faulty_box", str(folder / "data"), str(live_hz), str(fps), str(film_s)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._log,
            text=True,
        )
        assert self._child.stdout is not None
        line = self._child.stdout.readline()
        if not line.strip().isdigit():
            raise SystemExit(f"The box did not start, see {self.log}.")
        self.port = int(line)
        self.process = psutil.Process(self._child.pid)
        self.paired: Pass = pair(self.port)

    @property
    def alive(self) -> bool:
        """Whether it is still the process that was started."""
        return self._child.poll() is None

    def fail(self, sensor: str, fault: str, for_s: float = 1e9, cure: str = "none") -> None:
        """Let the fault begin now."""
        self._say({"sensor": sensor, "fault": fault, "for_s": for_s, "cure": cure})

    def mend(self, sensor: str) -> None:
        """End every fault of the sensor."""
        self._say({"sensor": sensor, "mend": True})

    def ask(self, path: str, method: str = "GET", body: dict[str, Any] | None = None, timeout_s: float = 30.0) -> Any:
        """The answer as JSON, bytes of a picture, or None for 204. Raises AssertionError for anything but success."""
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=timeout_s)
        try:
            headers = {"Content-Type": "application/json", **self.paired.headers}
            connection.request(method, f"/api/v1{path}", json.dumps(body) if body is not None else None, headers)
            answer = connection.getresponse()
            data = answer.read()
        finally:
            connection.close()
        assert answer.status < 300, f"{method} {path}: {answer.status} {data.decode(errors='replace')[:300]}"
        if answer.getheader("Content-Type", "").startswith("application/json"):
            return json.loads(data)
        return data or None

    def sensor(self, sensor: str) -> dict[str, Any]:
        """State, age, drops of one sensor as the health page has them."""
        found: dict[str, Any] = next(one for one in self.ask("/health")["sensors"] if one["role"] == sensor)
        return found

    def wait(self, condition: Callable[[], Any], within_s: float) -> bool:
        """Whether it came true in time."""
        deadline = time.monotonic() + within_s
        while time.monotonic() < deadline:
            if condition():
                return True
            time.sleep(0.05)
        return bool(condition())

    def listen(self, seconds: float) -> threading.Thread:
        """A page that stays open: live events until the time is over or the box is gone."""

        def run() -> None:
            connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
            with contextlib.suppress(OSError, http.client.HTTPException):
                connection.request("GET", "/api/v1/events", headers=self.paired.headers)
                answer = connection.getresponse()
                end = time.monotonic() + seconds
                while time.monotonic() < end and answer.read1(65536):
                    pass
            connection.close()

        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        return thread

    def _say(self, command: dict[str, Any]) -> None:
        assert self._child.stdin is not None
        self._child.stdin.write(json.dumps(command) + "\n")
        self._child.stdin.flush()

    def close(self) -> int:
        """Stop it; its exit status."""
        self._child.terminate()
        try:
            status = self._child.wait(30)
        except subprocess.TimeoutExpired:
            self._child.kill()
            status = self._child.wait()
        self._log.close()
        return status


@contextlib.contextmanager
def faulty_box(folder: Path, live_hz: float = 4.0, fps: float = CCTV_FPS, film_s: float = 0.0) -> Iterator[FaultyBox]:
    """A box for as long as the block lasts."""
    box = FaultyBox(folder, live_hz, fps, film_s)
    try:
        yield box
    finally:
        box.close()


def _serve(folder: Path, live_hz: float, fps: float, film_s: float) -> None:
    import logging
    import signal

    from device.config import Settings
    from device.daemon import Device
    from device.landmarks.virtual_crawler import virtual_crawler
    from device.memory import keep_heaps_small
    from drivers.virtual.cameras import demo_bus
    from drivers.virtual.drive import demo_drive
    from drivers.virtual.faults import FaultScript
    from drivers.virtual.grabber import Footage
    from tests.bench.film import Film
    from web_ui.app import create_app
    from web_ui.server import make_server

    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(levelname)s %(name)s: %(message)s")
    keep_heaps_small()
    scripts = {"camera": demo_bus(1, None).cameras[0].faults, "grabber": FaultScript(), "encoder": FaultScript()}
    footage = Film(demo_drive(1), fps, film_s) if film_s else Footage(demo_drive(1), fps)
    settings = Settings(data_dir=folder, cameras=("virtual",), pin=PIN, live_hz=live_hz)
    device = Device(
        settings,
        feeds=[] if film_s else None,
        crawler=lambda store: virtual_crawler(1, store, lambda: None, (scripts["grabber"], scripts["encoder"]), footage),
    )
    server = make_server(create_app(device), "127.0.0.1", 0)

    def obey() -> None:
        for line in sys.stdin:
            command = json.loads(line)
            script = scripts[command["sensor"]]
            if command.get("mend"):
                script.trigger("reconnect")
                script.end()
            else:
                script.trigger(command["fault"], command["for_s"], command["cure"])

    def stop(number: int, frame: object) -> None:
        device.end_streams()
        raise SystemExit(0)

    signal.signal(signal.SIGTERM, stop)
    try:
        device.start()
        threading.Thread(target=obey, daemon=True).start()
        print(server.effective_port, flush=True)
        server.run()
    finally:
        device.close()


if __name__ == "__main__":
    _serve(Path(sys.argv[1]), *(float(word) for word in sys.argv[2:]))
