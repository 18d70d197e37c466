"""What one camera's recording comes to: its estimates in the order of its frames, however late each came; the frame to show."""

from __future__ import annotations

import statistics

from drivers.depth.base import DepthFrame
from estimators.frame import FrameEstimate


class Take:
    """Estimates may be added in any order; they count in that of their frames, so that the result is the same each time."""

    def __init__(self) -> None:
        self.estimates: list[FrameEstimate] = []
        self.failed = 0
        """Frames whose estimate did not come back."""
        self.kept: tuple[DepthFrame, FrameEstimate] | None = None
        """The picture nearest to the median diameter so far, for the cloud and the colour picture."""
        self._next = 0
        self._early: dict[int, tuple[DepthFrame, FrameEstimate] | None] = {}

    def add(self, index: int, found: tuple[DepthFrame, FrameEstimate] | None) -> None:
        """The ``index``-th frame with its estimate, None where that failed."""
        self._early[index] = found
        while self._next in self._early:
            found = self._early.pop(self._next)
            self._next += 1
            if found is None:
                self.failed += 1
            else:
                self.estimates.append(found[1])
                self._keep(*found)

    def _keep(self, frame: DepthFrame, estimate: FrameEstimate) -> None:
        if estimate.diameter is None:
            if self.kept is None:
                self.kept = frame, estimate
            return
        median = statistics.median(e.diameter for e in self.estimates if e.diameter is not None)
        kept = None if self.kept is None else self.kept[1].diameter
        if kept is None or abs(estimate.diameter - median) < abs(kept - median):
            self.kept = frame, estimate
