"""What computed a result: the same numbers come out bit by bit only where all of this is the same."""

from __future__ import annotations

import platform
from importlib.metadata import PackageNotFoundError, version

_PACKAGES = ("borescout", "numpy", "scipy", "opencv-python-headless", "onnxruntime")


def versions() -> dict[str, str]:
    """Program, libraries, Python and machine, by name."""
    found = {"python": platform.python_version(), "machine": f"{platform.system()} {platform.machine()}"}
    for package in _PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = ""
    return found
