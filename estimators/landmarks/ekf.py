"""The bank of filters, one per landmark, all at once (CCTV paper, eqs. 10 to 17 and 19 to 21).

State [chainage (m), image angle (rad)], at rest on the wall. The update is iterated: far ahead the picture is anything but
linear in the chainage, and eq. 16 taken once settles on a wrong depth with a small covariance.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from estimators.landmarks.projection import NEAREST, PipeCamera, View, back_project, jacobian, project

Array = NDArray[np.float64]

ITERATIONS = 3
WANDER = np.array([0.004**2, 0.006**2])
"""Process noise Q per metre driven (m^2, rad^2): errors of the centre and of the tether last over many frames, so the filter
must not count each frame as fresh for ever."""


def measurement_noise(jacobians: Array, pixel_std: float, centre_std: float, position_std: float) -> Array:
    """R (..., 2, 2): noise of the detection, of the focus of expansion, and of the tether seen through d pixel / d chainage."""
    along = jacobians[..., :, 0]
    tether = along[..., :, None] * along[..., None, :] * position_std**2
    return np.asarray(tether + np.eye(2) * (pixel_std**2 + centre_std**2), dtype=np.float64)


def initial(
    camera: PipeCamera, view: View, pixels: Array, pixel_std: float, centre_std: float, position_std: float
) -> tuple[Array, Array]:
    """States (n, 2) and covariances (n, 2, 2) of new landmarks by back-projection (eqs. 19 to 21): P = J^-1 R J^-T."""
    states = back_project(camera, view, pixels)
    jac = jacobian(camera, view, states)
    noise = measurement_noise(jac, pixel_std, centre_std, position_std)
    inverse = np.linalg.inv(jac)
    return states, inverse @ noise @ np.swapaxes(inverse, 1, 2)


def update(
    camera: PipeCamera, view: View, states: Array, covariances: Array, pixels: Array, noise: Array
) -> tuple[Array, Array]:
    """Posterior of ``states`` (n, 2) given one pixel each (n, 2) with ``noise`` R (n, 2, 2) (eqs. 13 to 17, iterated).

    The chainage stays ahead of the camera throughout: a picture is of something ahead (DESIGN, "Where the papers slip").
    """
    if len(states) == 0:
        return states, covariances
    least = view.position + 2 * NEAREST
    prior = states.copy()
    prior[:, 0] = np.maximum(prior[:, 0], least)
    now = prior.copy()
    gain = jac = np.zeros((len(states), 2, 2))
    for _ in range(ITERATIONS):
        jac = jacobian(camera, view, now)
        innovation = pixels - project(camera, view, now) - np.einsum("nij,nj->ni", jac, prior - now)
        cross = covariances @ np.swapaxes(jac, 1, 2)
        gain = cross @ inverse2(jac @ cross + noise)
        now = prior + np.einsum("nij,nj->ni", gain, innovation)
        # A step may be a long one where the prior is wide; half the way to the camera is as near as one step may bring it.
        now[:, 0] = np.maximum(now[:, 0], view.position + 0.5 * (prior[:, 0] - view.position))
        now[:, 0] = np.maximum(now[:, 0], least)
    # Joseph form: symmetric and positive whatever the rounding.
    keep = np.eye(2) - gain @ jac
    posterior = keep @ covariances @ np.swapaxes(keep, 1, 2) + gain @ noise @ np.swapaxes(gain, 1, 2)
    now[:, 1] = wrap(now[:, 1])
    return now, posterior


def inverse2(matrices: Array) -> Array:
    """Inverse of (..., 2, 2), much cheaper than the general one for many small ones."""
    a, b, c, d = matrices[..., 0, 0], matrices[..., 0, 1], matrices[..., 1, 0], matrices[..., 1, 1]
    inverse = np.empty(matrices.shape)
    inverse[..., 0, 0], inverse[..., 0, 1], inverse[..., 1, 0], inverse[..., 1, 1] = d, -b, -c, a
    inverse /= (a * d - b * c)[..., None, None]
    return inverse


def wrap(angle: Array) -> Array:
    """Angles (rad) into [-pi, pi)."""
    return np.asarray((angle + np.pi) % (2 * np.pi) - np.pi, dtype=np.float64)
