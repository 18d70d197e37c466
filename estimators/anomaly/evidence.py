"""Whether the pictures speak for what was measured off the wall: patches must agree better there than on it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.anomaly.deviation import DeviationMap

_LEAST_PATCH = 0.4
"""Share of the windows that measured it which a part must fill: less is what one patch of the pictures says alone."""
_LEAST_GAIN = 0.08
"""By how much correlation patches must agree better off the wall than on it: else a smooth wall was misread, since the best of
several answers agrees a little better by chance. What fills a part of its windows has so many fewer pixels to say so: the root
of that share counts of it."""


def speaks(found: DeviationMap, cells: NDArray[np.intp]) -> bool:
    """Whether a connected part of the map, ``cells`` (flat indices), lies off the wall by what the pictures say."""
    area = float(found.area.ravel()[cells].sum())
    filled = area / max(float(found.patch.ravel()[cells].mean()), 1e-12)
    gain = float(found.gain.ravel()[cells].mean()) * min(1.0, filled**0.5)
    return filled >= _LEAST_PATCH and gain >= _LEAST_GAIN
