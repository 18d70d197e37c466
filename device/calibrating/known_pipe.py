"""``borescout calibrate stereo --known-pipe``: disparity offset and scale of a rig from a round pipe of known diameter."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np
from numpy.typing import NDArray

from device.anomaly.calibration import BoardCalibration, calibration_there, known_pipe_calibration, save_calibration
from device.anomaly.result import grey
from device.errors import Invalid
from drivers.stereo.replay import pair_folder, read_pair
from estimators.radial_profile.shape import shape_of
from estimators.stereo.follow import Refused, follow_wall
from estimators.stereo.known_pipe import KnownPipe, combined, rig_from_known_pipe
from estimators.stereo.rig import StereoRig

LARGEST_SCALE_ERROR = 0.06
"""A baseline that would have to be wrong by more than this is not corrected: the pipe is another, or the manifest is wrong."""
LARGEST_DISAGREEMENT_PX = 6.0


def by_known_pipe(known_pipe: Path, wanted: float, out: Path) -> None:
    """Calibrate with the pairs of a folder, in a pipe ``wanted`` (m) wide, and write ``out``. Raises Invalid."""
    if isinstance(calibration_there(out), BoardCalibration):
        raise Invalid(f"{out} holds a calibration of two lenses: choose another --out.")
    folder = pair_folder(known_pipe)
    found: list[KnownPipe] = []
    used: list[str] = []
    for number, entry in enumerate(folder.pairs):
        frame = read_pair(folder, entry, number)
        rig = StereoRig(frame.intrinsics, frame.baseline_m, None)
        try:
            known = _known(grey(frame.left), grey(frame.right), rig, wanted)
        except Refused as refusal:
            _warn(f"{entry.left} is left out: {refusal}")
            continue
        except Invalid as error:
            _warn(f"{entry.left} is left out: {error}")
            continue
        click.echo(
            f"{entry.left}: offset {known.offset_px:.1f} px (by the cone alone {known.cone_px:.1f}), scale {known.scale:.4f}"
        )
        found.append(known)
        used.append(entry.left)
    if not found:
        raise Invalid(f"No pair of {known_pipe} shows a round pipe that can be calibrated with.")
    spread = max(one.offset_px for one in found) - min(one.offset_px for one in found)
    if spread > LARGEST_DISAGREEMENT_PX:
        raise Invalid(
            f"The pairs of {known_pipe} disagree by {spread:.1f} px in their disparity offset: "
            f"they are not one rig in one pipe of {1000 * wanted:.0f} mm."
        )
    result = combined(found)
    save_calibration(out, known_pipe_calibration(result, folder.intrinsics.width, wanted, used))
    click.echo(
        f"Disparity offset {result.offset_px:.2f} ± {result.offset_std_px:.2f} px, baseline times {result.scale:.4f}: "
        f"written to {out}."
    )


def _known(left: NDArray[np.uint8], right: NDArray[np.uint8], rig: StereoRig, diameter: float) -> KnownPipe:
    """What one pair tells. Raises Refused, or Invalid where the pipe is not round or not of that size."""
    followed = follow_wall(left, right, rig, np.random.default_rng(6))
    shape = shape_of(followed.wall, np.asarray(followed.usable.any(axis=0), dtype=np.bool_), followed.grid.theta)
    if shape.name != "circle":
        raise Invalid("the pipe in it is not round.")
    # the width where it was seen: crown and invert often lie outside of the picture, and the circle leans on what is left
    measured = shape.fitted_width if shape.width is None else shape.width.value
    known = rig_from_known_pipe(followed, measured, diameter)
    if abs(known.scale - 1.0) > LARGEST_SCALE_ERROR:
        raise Invalid(
            f"a pipe of {1000 * diameter:.0f} mm would need a baseline {100 * abs(known.scale - 1.0):.0f} % off what is stated."
        )
    return known


def _warn(sentence: str) -> None:
    click.echo(f"borescout: {sentence}", err=True)
