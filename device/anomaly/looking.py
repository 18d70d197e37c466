"""``borescout anomaly --camera``: the newest pair of a live camera, again and again."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from typing import Any

import click

from device.errors import Invalid
from device.feeds.feed import StereoFeed
from drivers.base import DriverError
from drivers.stereo.base import StereoFrame

Names = dict[str, Any]
"""What a pair is known by: "left", and "right", "pipe", "end" and "chainage_m" of a recorded one."""
Pair = tuple[Names, StereoFrame | DriverError]

FIRST_S = 40.0
"""How long a camera may take until its first pair: an OAK boots at every start."""
SILENCE_S = 30.0
"""How long one that has sent pairs is waited for, while the feed brings it back."""
_TICK_S = 0.1


def looking(feed: StereoFeed, most: int | None) -> Iterator[Pair]:
    """The newest pair each time somebody asks, ``most`` of them or until Ctrl-C; the feed is the caller's to close. Raises
    Invalid where the camera does not come up, or does not come back."""
    feed.start()
    tap = feed.tap(1)  # the newest wins: what came while the last pair was being read is passed over
    told = ""
    given = 0
    heard = time.monotonic()
    click.echo("borescout: Looking; Ctrl-C ends it.", err=True)
    try:
        while most is None or given < most:
            frame = tap.get(_TICK_S)
            status = feed.status()
            if frame is None:
                if given == 0 and status.state == "lost":
                    raise Invalid(status.message or f"Nothing comes from the {feed.name}.")
                if given or status.state == "starting":
                    told = _told(status.message, told)
                if time.monotonic() - heard > (SILENCE_S if given else FIRST_S):
                    raise Invalid(f"Nothing comes from the {feed.name}: {status.message or 'it says nothing.'}")
                continue
            given += 1
            told = ""
            if sys.stderr.isatty():
                of = "" if most is None else f" of {most}"
                click.echo(f"\rpair {given}{of}, {status.fps:.0f} a second come   ", err=True, nl=False)
            yield {"left": f"{frame.source or feed.name} {frame.number}"}, frame
            heard = time.monotonic()
    finally:
        tap.close()


def _told(message: str, before: str) -> str:
    """Say what is wrong with the camera, once."""
    if message and message != before:
        click.echo(f"borescout: {message}", err=True)
    return message
