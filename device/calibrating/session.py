"""A calibration of two plain cameras from the page: somebody holds a board, the phone shows what is covered and what is not.

Nothing is changed before ``save``: what came out can be looked at first, and be thrown away.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2

from device.anomaly.calibration import BoardCalibration, RigSource, board_calibration, replace_calibration
from device.calibrating.board_views import Look, Picture, looks
from device.errors import Busy, DeviceError, Invalid
from device.feeds.feed import StereoFeed
from device.pictures import encode_jpeg
from drivers.base import DriverError
from drivers.stereo.two_cameras import GrabberPair
from estimators.board.board import Board, Sighting
from estimators.board.calibration import LEAST_COVERED, LEAST_TILTS, NotEnough, calibrate_pair
from estimators.board.coverage import TILTS
from estimators.board.gathering import WANTED_VIEWS

log = logging.getLogger(__name__)

SIDES = ("left", "right")
RELEASE_S = 15.0
"""How long the feed may take to let go of the cameras."""
ABANDONED_S = 120.0
"""A calibration whose state nobody asks for is ended: the cameras are wanted for scans."""
_ABANDONED = "Nobody looked at the page for two minutes, so the calibration was ended: begin anew."
_UNEXPECTED = "The calibration failed inside the box; its log says what."
_MARK = (60, 220, 60)


class CalibrationSession:
    """One calibration at a time, in a thread of its own; errors are DeviceErrors. ``cameras`` makes the pair, which ``feed``
    lets go of meanwhile; what is saved goes to ``file`` and into ``source``."""

    def __init__(self, cameras: Callable[[], GrabberPair], feed: StereoFeed, source: RigSource, file: Path) -> None:
        self._cameras = cameras
        self._feed = feed
        self._source = source
        self._file = file
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._ending = threading.Event()
        self._asked = 0.0
        self._cancelled = False
        self._state = "idle"
        self._message = ""
        self._board: Board | None = None
        self._look: Look | None = None
        self._found: BoardCalibration | None = None
        self._left_out: tuple[tuple[str, float], ...] = ()

    @property
    def busy(self) -> bool:
        """Whether the cameras are lent to it."""
        return self._state in ("gathering", "computing")

    def start(self, board: Board) -> None:
        """Begin to look for ``board``. Raises Busy."""
        with self._lock:
            if self.busy:
                raise Busy("A calibration is under way: finish or cancel it first.")
            self._state, self._message, self._board = "gathering", "", board
            self._look = self._found = None
            self._left_out = ()
            self._cancelled = False
            self._ending.clear()
            self._asked = time.monotonic()
            self._thread = threading.Thread(target=self._run, args=(board,), name="calibration", daemon=True)
            self._thread.start()
        log.info("calibration with %s: begins", board.name)

    def finish(self) -> None:
        """Calibrate with what was shown until now. Raises Invalid."""
        if self._state != "gathering":
            raise Invalid("No calibration is under way.")
        self._ending.set()

    def cancel(self) -> None:
        """Forget what was shown, and what came out."""
        with self._lock:
            self._cancelled = True
            self._ending.set()
            if not self.busy:
                self._state, self._message, self._found = "idle", "", None

    def save(self) -> None:
        """Use what came out from now on. Raises Invalid where nothing did, or the file holds something better."""
        with self._lock:
            found = self._found
            if self._state != "done" or found is None:
                raise Invalid("There is no calibration to save: show the board first.")
            replace_calibration(self._file, found)
            self._source.calibration = found
            self._state = "saved"
        log.info("calibration saved to %s", self._file)

    def close(self, wait_s: float = 5.0) -> None:
        """Stop. May be called twice."""
        self.cancel()
        if self._thread is not None:
            self._thread.join(wait_s)

    def state(self) -> dict[str, Any]:
        """For the page: {"state", "message", "board", "calibrated", "views", "views_wanted", "covered", "covered_wanted",
        "tilts", "tilts_wanted", "seen", "next", "found"}; "state" is "idle", "gathering", "computing", "done", "failed" or
        "saved"."""
        self._asked = time.monotonic()
        look, known = self._look, self._source.calibration
        covered = None if look is None else look.gathering.covered()
        return {
            "state": self._state,
            "message": self._message,
            "board": None if self._board is None else self._board.name,
            "calibrated": _told(known) if isinstance(known, BoardCalibration) else None,
            "views": 0 if look is None else len(look.gathering.views),
            "views_wanted": WANTED_VIEWS,
            "covered": None if covered is None else {side: getattr(covered, side).tolist() for side in SIDES},
            "covered_wanted": LEAST_COVERED,
            "tilts": dict(zip(TILTS, (0,) * len(TILTS) if covered is None else covered.tilts, strict=True)),
            "tilts_wanted": LEAST_TILTS,
            "seen": "" if look is None else look.why or "kept",
            "next": "" if look is None else look.gathering.wanted(),
            "found": None if self._found is None else {**_told(self._found), "left_out": [name for name, _ in self._left_out]},
        }

    def picture(self, side: str) -> bytes | None:
        """JPEG of the newest "left" or "right" picture with the corners that were found, None where there is none."""
        look = self._look
        if look is None:
            return None
        k = SIDES.index(side)
        return encode_jpeg(_marked(look.pictures[k], look.seen[k]))

    # The thread of one calibration

    def _run(self, board: Board) -> None:
        state, message = "failed", _UNEXPECTED
        self._feed.lend(True)
        try:
            self._gather(board)
            if not self._cancelled:
                self._state = "computing"
                self._compute(board)
                state, message = "done", ""
        except (DeviceError, DriverError, NotEnough) as error:
            message = str(error)
        except Exception:  # the last net: a calibration costs nothing but itself
            log.exception("the calibration failed in an unexpected way")
        finally:
            self._feed.lend(False)
        with self._lock:
            self._state, self._message = ("idle", "") if self._cancelled else (state, message)
            if self._cancelled:
                self._found = None
        log.info("calibration: %s%s", self._state, f", {self._message}" if self._message else "")

    def _gather(self, board: Board) -> None:
        """Look until there is enough, or somebody ends it."""
        if not self._feed.at_rest(RELEASE_S):
            raise Invalid("The cameras are busy: unplug both, plug them in again, and begin anew.")
        for look in looks(board, self._cameras(), self._goes_on):
            self._look = look

    def _goes_on(self) -> bool:
        if time.monotonic() - self._asked > ABANDONED_S:
            raise Invalid(_ABANDONED)
        return not self._ending.is_set()

    def _compute(self, board: Board) -> None:
        look = self._look
        if look is None:
            raise NotEnough("The cameras sent no picture.")
        result = calibrate_pair(board, look.gathering.views, look.size)
        self._left_out = result.left_out
        self._found = board_calibration(result, board.name)


def _told(found: BoardCalibration) -> dict[str, Any]:
    """A calibration in the units of the page."""
    return {
        "board": found.board,
        "views": found.views,
        "reprojection_px": round(found.reprojection_px, 2),
        "epipolar_px": round(found.epipolar_px, 2),
        "offset_std_px": round(found.offset_std_px, 2),
        "scale_percent": round(100 * found.scale_std, 2),
        "baseline_mm": round(1000 * abs(found.translation_m[0]), 2),
    }


def _marked(picture: Picture, seen: Sighting | None) -> Picture:
    """A copy with the corners of the board."""
    drawn = picture.copy()
    size = max(2, round(picture.shape[1] / 160))
    for u, v in [] if seen is None else seen.pixels:
        cv2.circle(drawn, (round(float(u)), round(float(v))), size, _MARK, -1, cv2.LINE_AA)
    return drawn
