"""Connected parts of an unrolled wall: it has no edge where it was cut."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components


def parts_around(mask: NDArray[np.bool_]) -> tuple[NDArray[np.int32], int]:
    """Labels (Z, A) from 1 on of the connected parts of an unrolled mask, whose left and right edge are neighbours, and their
    number."""
    count, labels = cv2.connectedComponents(mask.astype(np.uint8), connectivity=8)
    left, right = (np.asarray(labels[:, edge], dtype=np.int64) for edge in (0, -1))
    meeting = (left > 0) & (right > 0)
    graph = coo_matrix((np.ones(meeting.sum()), (left[meeting], right[meeting])), shape=(count, count))
    found, merged = connected_components(graph, directed=False)
    if found < count:
        renumbered = np.zeros(found, dtype=np.int32)
        others = [part for part in range(found) if part != merged[0]]
        renumbered[others] = np.arange(1, found)
        labels = renumbered[merged][labels]
        count = found
    return labels.astype(np.int32), count - 1
