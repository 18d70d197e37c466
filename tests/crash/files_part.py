"""Configuration in files under a power cut: the PIN of the label, and files that are replaced as a whole."""

from __future__ import annotations

import json
from pathlib import Path
from random import Random

from device.access.pin import pin_of
from device.durable import make_folder, write_whole
from device.errors import DeviceError
from tests.crash.marks import Promises
from tests.crash.shim import mark

IGNORED: tuple[str, ...] = ()
NAMES = ("one.json", "deep/er/two.json")


class FilesWork:
    """Each step replaces a file."""

    def __init__(self, folder: Path, rng: Random) -> None:
        self._folder, self._rng = folder, rng
        pin = pin_of(folder)
        mark("shown", "pin", pin)

    def step(self) -> None:
        name = self._rng.choice(NAMES)
        content = {"number": self._rng.randrange(10**9), "long": "x" * self._rng.randrange(5000)}
        mark("begin", name, content)
        file = self._folder / name
        make_folder(file.parent)
        write_whole(file, json.dumps(content).encode())
        mark("shown", name, content)

    def close(self) -> None: ...


def check(folder: Path, promises: Promises) -> list[str]:
    """What is wrong with the files in ``folder``."""
    wrong = []
    for name in NAMES:
        file = folder / name
        try:
            found = json.loads(file.read_bytes()) if file.exists() else None
        except ValueError as error:
            wrong.append(f"unreadable: {name} is a piece of a file, {error}")
            continue
        if sentence := promises.broken(name, found):
            wrong.append(sentence)
    if "pin" in promises.shown or folder.exists():
        try:
            pin = pin_of(folder)
        except DeviceError as error:
            return [*wrong, f"unreadable: {error}"]
        if "pin" in promises.shown and pin != promises.shown["pin"]:
            wrong.append("the PIN that is on the label opens no more")
    return wrong
