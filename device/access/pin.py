"""The PIN on the label: drawn at the first start, never a default, readable by the owner of the machine alone."""

from __future__ import annotations

import re
import secrets
from pathlib import Path

from device.durable import make_folder, write_whole
from device.errors import StoreUnusable

FILE_NAME = "pin"
DIGITS = 6
_FORM = re.compile(rf"[0-9]{{{DIGITS}}}", re.ASCII)


def pin_of(folder: Path) -> str:
    """The PIN of the box whose data are in ``folder``; the first call draws it. Raises StoreUnusable."""
    file = folder / FILE_NAME
    try:
        kept = file.read_text(encoding="ascii", errors="replace").strip()
    except FileNotFoundError:
        return new_pin(folder)
    except OSError as error:
        raise StoreUnusable(f"The PIN in {file} cannot be read: {error.strerror}.") from None
    if not _FORM.fullmatch(kept):
        raise StoreUnusable(f"The file {file} holds no PIN of {DIGITS} digits: write one into it, or delete it for a new one.")
    return kept


def new_pin(folder: Path) -> str:
    """Draw another PIN and keep it, mode 0600. Raises StoreUnusable."""
    pin = f"{secrets.randbelow(10**DIGITS):0{DIGITS}d}"
    try:
        make_folder(folder)
        write_whole(folder / FILE_NAME, f"{pin}\n".encode("ascii"), 0o600)
    except OSError as error:
        raise StoreUnusable(f"The PIN cannot be kept in {folder}: {error.strerror}.") from None
    return pin
