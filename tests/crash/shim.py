"""The layer below Python: ``shim.c`` built where the test keeps its things, and what it logs read back."""

from __future__ import annotations

import ctypes
import json
import os
import shutil
import struct
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
SOURCE = Path(__file__).with_name("shim.c")
OPS = ("create", "write", "truncate", "sync", "rename", "unlink", "mkdir", "sync folder", "mark", "rmdir")
_HEAD = struct.Struct("<IIIIQqQ")


@dataclass(frozen=True)
class Operation:
    """``op`` is one of OPS. Paths are below the watched folder, "" is the folder itself. ``offset`` is where a write begins,
    what a file is truncated to, the mode of what is created. A mark's ``data`` is its text."""

    op: str
    path: str = ""
    path2: str = ""
    inode: int = 0
    offset: int = 0
    data: bytes = b""
    ns: int = 0


def missing() -> str:
    """Why the shim cannot be used here; empty where it can."""
    if not sys.platform.startswith("linux"):
        return "the shim below Python needs Linux"
    if shutil.which("gcc") is None:
        return "there is no gcc to build the shim below Python"
    return ""


def build(folder: Path) -> Path:
    """The shim, compiled into ``folder``. Raises CalledProcessError."""
    library = folder / "shim.so"
    if not library.exists():
        command = ["gcc", "-O2", "-Wall", "-Werror", "-shared", "-fPIC", "-o", str(library), str(SOURCE), "-ldl"]
        subprocess.run(command, check=True, capture_output=True)
    return library


def environment(library: Path, watched: Path, log: Path | None, room: int | None = None) -> dict[str, str]:
    """What a watched program is started with; ``room`` is the size (bytes) of the disk that is played for it."""
    extra = {"LD_PRELOAD": str(library), "CRASH_ROOT": str(watched)}
    if log is not None:
        extra["CRASH_LOG"] = str(log)
    if room is not None:
        extra["CRASH_FREE"] = str(room)
    return {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", **extra}


def run(library: Path, watched: Path, log: Path | None, arguments: Sequence[str], **options: Any) -> str:
    """Run ``python -m ARGUMENTS`` watched; what it printed. Raises CalledProcessError."""
    done = subprocess.run(
        [sys.executable, "-m", *arguments],
        cwd=ROOT,
        env=environment(library, watched, log, **options),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{' '.join(arguments)} ended with {done.returncode}:\n{done.stderr}")
    return done.stdout


def read_log(file: Path) -> Iterator[Operation]:
    """Everything that was done, in its order. A record that was being written when the program was killed is left out."""
    data, at = file.read_bytes(), 0
    while at + _HEAD.size <= len(data):
        op, path, path2, size, inode, offset, ns = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        if at + path + path2 + size > len(data):
            return
        names = data[at : at + path + path2].decode()
        body = data[at + path + path2 : at + path + path2 + size]
        at += path + path2 + size
        yield Operation(OPS[op - 1], names[:path], names[path:], inode, offset, body, ns)


# In the watched program


@cache
def _library() -> ctypes.CDLL | None:
    library = ctypes.CDLL(None)
    if not hasattr(library, "crash_mark"):
        return None
    library.crash_fail.argtypes = [ctypes.c_int64, ctypes.c_int64, ctypes.c_int]
    library.crash_room.argtypes = [ctypes.c_int64]
    library.crash_room_left.restype = ctypes.c_int64
    library.crash_writes.restype = ctypes.c_uint64
    return library


def loaded() -> ctypes.CDLL:
    """The shim of this very process. Raises RuntimeError where it runs without."""
    library = _library()
    if library is None:
        raise RuntimeError("this program has to be started with the shim")
    return library


def mark(what: str, key: str, content: Any = None) -> None:
    """Write into the log that ``key`` with ``content`` was begun, shown ... just now."""
    loaded().crash_mark(json.dumps({"what": what, "key": key, "content": content}).encode())
