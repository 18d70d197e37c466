"""From ``borescout serve --virtual`` to the first answer of the page, and to READY, beside the imports of its packages alone.

python -m tests.bench.start [--runs 5]
"""

from __future__ import annotations

import argparse
import os
import socket
import statistics
import subprocess
import sys
import tempfile
import time
import urllib.error
import urllib.request
from pathlib import Path

from tests.bench.table import print_table

PACKAGES = "import numpy, scipy.optimize, cv2, flask, pydantic, waitress, click"
LIMIT_S = 120.0


def one_start(folder: Path) -> tuple[float, float]:
    """Seconds to the page and to READY."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    heard = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    heard.bind(str(folder / "notify"))
    heard.settimeout(0.01)
    begun = time.monotonic()
    command = [
        sys.executable,
        "-m",
        "device.cli",
        "serve",
        "--virtual",
        "--port",
        str(port),
        "--data-dir",
        str(folder / "data"),
    ]
    environment = {**os.environ, "NOTIFY_SOCKET": str(folder / "notify")}
    box = subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    page = ready = None
    try:
        while (page is None or ready is None) and time.monotonic() - begun < LIMIT_S:
            if page is None and answers(port):
                page = time.monotonic() - begun
            try:
                if "READY=1" in heard.recv(4096).decode().splitlines():
                    ready = time.monotonic() - begun
            except TimeoutError:
                continue
    finally:
        box.terminate()
        box.wait(30)
        heard.close()
    if page is None or ready is None:
        raise SystemExit(f"The box did not start within {LIMIT_S:.0f} s.")
    return page, ready


def answers(port: int) -> bool:
    """Whether the page does."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/pair", timeout=2) as answer:
            return bool(answer.status == 200)
    except (OSError, urllib.error.URLError):
        return False


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.start", description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--runs", type=int, default=5)
    pages, readies, imports = [], [], []
    for _ in range(parser.parse_args().runs):
        begun = time.monotonic()
        subprocess.run([sys.executable, "-c", PACKAGES], check=True)
        imports.append(time.monotonic() - begun)
        with tempfile.TemporaryDirectory() as folder:
            page, ready = one_start(Path(folder))
        pages.append(page)
        readies.append(ready)
    named = (("packages imported", imports), ("page answers", pages), ("READY: camera and tether up", readies))
    rows = [(name, f"{min(some):.2f}", f"{statistics.median(some):.2f}", f"{max(some):.2f}") for name, some in named]
    print_table(f"Start, seconds, load {os.getloadavg()[0]:.1f}", ("", "best", "median", "worst"), rows)


if __name__ == "__main__":
    main()
