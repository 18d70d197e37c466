"""How brightly the lamp should shine, from the time, the picture's exposure and the crawler's way, all told to it.

Light is changed in steps of a third, one at a time, and only when the picture lies outside a band that is wider than a step:
a lamp that hunts would be worse for tracking than one that is a little too bright.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class LampRules:
    """When the lamp is changed. Grey values are of the bright part of the picture (its 90th percentile, 0 to 255)."""

    dark: float = 105.0
    bright: float = 235.0
    """Below and above these the light is changed; between them it stays."""
    step: float = 4 / 3
    pace_s: float = 0.6
    """A camera with an exposure of its own needs a while to settle after a change."""
    lowest: float = 0.05
    begin: float = 0.5
    off_after_s: float = 120.0
    """Without way or look for so long, the lamp goes out."""


def exposure(image: NDArray[np.uint8]) -> float:
    """The grey value below which 90 % of the picture (H, W, 3) lie, from every eighth row and column."""
    return float(np.percentile(image[::8, ::8].mean(axis=2), 90))


class LampControl:
    """Decides the level. ``automatic`` follows the exposure, otherwise ``level`` is what was set; both go out on standstill."""

    def __init__(self, rules: LampRules | None = None, level: float | None = None, automatic: bool = True) -> None:
        self.rules = rules or LampRules()
        self.automatic = automatic
        self.level = self.rules.begin if level is None else level
        self.resting = False
        """Whether it is out because nothing moves."""
        self._moved_s: float | None = None
        self._changed_s: float | None = None

    def stir(self, now_s: float) -> None:
        """Something moves, or somebody looks."""
        self._moved_s = now_s
        if self.resting:
            self._changed_s = now_s  # the first pictures in the new light are not there yet
        self.resting = False

    def step(self, now_s: float, exposure: float | None, may_rest: bool) -> float:
        """The level to shine at. ``exposure`` is that of a picture taken since the last step, None without one; ``may_rest``:
        there is something that tells when the crawler moves again, so the lamp may go out."""
        if self._moved_s is None:
            self._moved_s = now_s
        self.resting = may_rest and now_s - self._moved_s >= self.rules.off_after_s
        if self.resting:
            return 0.0
        if self.automatic and exposure is not None and self._settled(now_s):
            wanted = self.level
            if exposure < self.rules.dark:
                wanted = min(1.0, max(self.level, self.rules.lowest) * self.rules.step)
            elif exposure > self.rules.bright:
                wanted = max(self.rules.lowest, self.level / self.rules.step)
            if wanted != self.level:
                self.level, self._changed_s = wanted, now_s
        return self.level

    def _settled(self, now_s: float) -> bool:
        return self._changed_s is None or now_s - self._changed_s >= self.rules.pace_s
