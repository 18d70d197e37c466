"""`borescout serve` for the length of a benchmark."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.bench.real_data import fail
from tests.pairing import PIN


@contextmanager
def running(folder: Path, source: list[str]) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """The process and the port of a daemon with the cameras that ``source`` names; it keeps everything in ``folder``."""
    setting = ["--port", "0", "--pin", PIN, "--data-dir", str(folder / "data")]
    log = folder / "log.txt"
    with (
        log.open("w") as errors,
        subprocess.Popen(
            [sys.executable, "-m", "device.cli", "serve", *source, *setting], stdout=subprocess.PIPE, stderr=errors, text=True
        ) as process,
    ):
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            if "http://" not in line:
                fail(f"'borescout serve' did not start: {log.read_text().strip().splitlines()[-1:]}")
            yield process, int(line.strip().rsplit(":", 1)[1])
        finally:
            process.terminate()
            try:
                process.wait(15)
            except subprocess.TimeoutExpired:
                process.kill()
