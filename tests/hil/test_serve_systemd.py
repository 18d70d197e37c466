"""``borescout serve`` as systemd starts it: told when it is ready, fed while it turns, told when it stops."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from tests.unit.device.device_doubles import eventually
from tests.unit.device.test_notify import Manager


def test_the_service_manager_hears_of_ready_of_life_and_of_the_end(tmp_path: Path) -> None:
    manager = Manager(str(tmp_path / "notify"))
    command = [sys.executable, "-m", "device.cli", "serve", "--virtual", "--port", "0", "--data-dir", str(tmp_path / "data")]
    environment = {**os.environ, "NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "600000"}
    box = subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    try:
        assert eventually(lambda: manager.heard("READY=1"), 90)
        line = "STATUS=virtual stereo up, virtual CCTV resting, virtual tether up"
        assert eventually(lambda: manager.heard(line), 30)
        fed = manager.heard("WATCHDOG=1")
        assert eventually(lambda: manager.heard("WATCHDOG=1") > fed + 2, 30)
        box.send_signal(signal.SIGSTOP)  # every loop stands still
        time.sleep(0.3)  # what was on its way
        fed = manager.heard("WATCHDOG=1")
        time.sleep(1.0)
        assert manager.heard("WATCHDOG=1") == fed
        box.send_signal(signal.SIGCONT)
        assert eventually(lambda: manager.heard("WATCHDOG=1") > fed, 30)
        box.terminate()
        assert box.wait(30) == 0
        assert eventually(lambda: manager.heard("STOPPING=1") == 1)
        assert manager.heard("READY=1") == 1
    finally:
        box.kill()
        box.wait()
        manager.close()
