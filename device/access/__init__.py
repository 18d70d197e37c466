"""Who may use the box: pairing by the PIN on its label, sessions, and the one phone that is in control."""

from __future__ import annotations

from device.access.access import Access, Paired
from device.access.pin import pin_of
from device.access.sessions import Session

__all__ = ["Access", "Paired", "Session", "pin_of"]
