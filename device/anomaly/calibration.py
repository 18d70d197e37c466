"""The calibration file of a stereo rig: what a known pipe, or a board, told of it. JSON, read and written here alone."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from device.errors import Invalid
from drivers.stereo.base import StereoFrame
from drivers.stereo.rectifier import Calibrated
from estimators.board.calibration import PairCalibration
from estimators.pinhole import Intrinsics, LensPair, rectified
from estimators.stereo.known_pipe import KnownPipe
from estimators.stereo.rig import StereoRig


class KnownPipeCalibration(BaseModel):
    """Offset and scale from a pipe of known diameter. Pixels are those of pictures ``width`` wide."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    kind: str = Field(default="known_pipe", pattern="^known_pipe$")
    width: int = Field(gt=0)
    offset_px: float
    offset_std_px: float = Field(ge=0)
    scale: float = Field(gt=0.5, lt=2.0)
    scale_std: float = Field(ge=0)
    shift_px: float = Field(gt=0)
    diameter_m: float = Field(gt=0)
    pairs: list[str]


class Lens(BaseModel):
    """One camera as it throws its pictures, in pixels; ``coeffs`` are k1, k2, p1, p2, k3 as in OpenCV."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    fx: float = Field(gt=0)
    fy: float = Field(gt=0)
    ppx: float
    ppy: float
    coeffs: list[float] = Field(min_length=5, max_length=5)


class BoardCalibration(BaseModel):
    """Two plain cameras, from views of a board. A point is p_right = ``rotation`` p_left + ``translation_m``."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    kind: Literal["board"] = "board"
    width: int = Field(gt=0)
    height: int = Field(gt=0)
    left: Lens
    right: Lens
    rotation: list[float] = Field(min_length=9, max_length=9)
    translation_m: list[float] = Field(min_length=3, max_length=3)
    reprojection_px: float = Field(ge=0)
    epipolar_px: float = Field(ge=0)
    offset_std_px: float = Field(ge=0)
    scale_std: float = Field(ge=0)
    views: int = Field(gt=0)
    board: str

    @model_validator(mode="after")
    def _a_pair(self) -> BoardCalibration:
        rectified(self.lenses())  # raises ValueError for cameras that are no pair, or no lenses at all
        return self

    def lenses(self) -> LensPair:
        """Both cameras."""
        left, right = (
            Intrinsics(self.width, self.height, lens.fx, lens.fy, lens.ppx, lens.ppy, "brown_conrady", tuple(lens.coeffs))
            for lens in (self.left, self.right)
        )
        x, y, z = self.translation_m
        return LensPair(left, right, tuple(self.rotation), (x, y, z))

    def calibrated(self) -> Calibrated:
        """What a driver rectifies with."""
        return Calibrated(self.lenses(), self.offset_std_px, self.scale_std)


StereoCalibration = KnownPipeCalibration | BoardCalibration


def save_calibration(path: Path, calibration: BaseModel) -> None:
    """Write the file whole or not at all."""
    draft = path.with_name(path.name + ".part")
    try:
        draft.write_text(calibration.model_dump_json(indent=2) + "\n", encoding="utf-8")
        os.replace(draft, path)
    except OSError as error:
        raise Invalid(f"The calibration cannot be written to {path}: {error.strerror or error}.") from error


def load_calibration(path: Path) -> StereoCalibration:
    """Read a file that ``save_calibration`` wrote. Raises Invalid."""
    try:
        found: Any = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise Invalid(f"The calibration {path} cannot be read: {error.strerror or error}.") from error
    except (ValueError, RecursionError) as error:
        raise Invalid(f"The calibration {path} is no JSON: {error}.") from error
    by_board = isinstance(found, dict) and found.get("kind") == "board"
    kind: type[StereoCalibration] = BoardCalibration if by_board else KnownPipeCalibration
    try:
        return kind.model_validate(found)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "file"
        what = "two lenses" if by_board else "a known pipe"
        raise Invalid(f"The calibration {path} is not one of {what}: {where}: {first['msg']}.") from error


def calibration_there(path: Path) -> StereoCalibration | None:
    """The calibration that a new one would take the place of, None where the file holds none."""
    try:
        return load_calibration(path)
    except Invalid:
        return None


_MUCH_WORSE = 2.0


def replace_calibration(path: Path, new: BoardCalibration) -> None:
    """Save ``new``. Raises Invalid where the file holds a calibration that it must not take the place of."""
    old = calibration_there(path)
    if isinstance(old, KnownPipeCalibration):
        raise Invalid(f"{path} holds a calibration by a known pipe: choose another file.")
    if old is not None and new.offset_std_px > _MUCH_WORSE * old.offset_std_px:
        raise Invalid(
            f"The calibration in {path} is better (disparities ± {old.offset_std_px:.2f} px, this one "
            f"± {new.offset_std_px:.2f} px) and stays: take more views, or choose another file."
        )
    save_calibration(path, new)


@dataclass
class RigSource:
    """Makes the rig of a frame: what the camera states, corrected by a calibration where there is one; a new one may take its
    place."""

    calibration: StereoCalibration | None = None

    @property
    def lenses(self) -> Calibrated | None:
        """What the pictures are rectified with before this is asked for their rig, None where they come rectified."""
        return self.calibration.calibrated() if isinstance(self.calibration, BoardCalibration) else None

    def rig(self, frame: StereoFrame) -> StereoRig:
        """The rig to read this frame with. Raises Invalid where the calibration is of other pictures."""
        found = self.calibration
        if not isinstance(found, KnownPipeCalibration):
            return StereoRig(frame.intrinsics, frame.baseline_m, frame.offset_px, frame.offset_std_px, frame.scale_std)
        if found.width != frame.intrinsics.width:
            raise Invalid(f"The calibration is for pictures {found.width} wide, these are {frame.intrinsics.width}.")
        return StereoRig(
            frame.intrinsics,
            frame.baseline_m * found.scale,
            found.offset_px,
            found.offset_std_px,
            found.scale_std,
            found.shift_px,
        )


def board_calibration(found: PairCalibration, board: str) -> BoardCalibration:
    """The file's content."""
    lenses = found.lenses
    left, right = (
        Lens(fx=lens.fx, fy=lens.fy, ppx=lens.ppx, ppy=lens.ppy, coeffs=list(lens.coeffs))
        for lens in (lenses.left, lenses.right)
    )
    return BoardCalibration(
        width=lenses.left.width,
        height=lenses.left.height,
        left=left,
        right=right,
        rotation=list(lenses.rotation),
        translation_m=list(lenses.translation),
        reprojection_px=round(found.reprojection_px, 4),
        epipolar_px=round(found.epipolar_px, 4),
        offset_std_px=round(found.offset_std_px, 4),
        scale_std=round(found.scale_std, 5),
        views=len(found.views),
        board=board,
    )


def known_pipe_calibration(known: KnownPipe, width: int, diameter_m: float, pairs: list[str]) -> KnownPipeCalibration:
    """The file's content."""
    return KnownPipeCalibration(
        width=width,
        offset_px=round(known.offset_px, 3),
        offset_std_px=round(known.offset_std_px, 3),
        scale=round(known.scale, 5),
        scale_std=round(known.scale_std, 5),
        shift_px=round(known.shift_px, 3),
        diameter_m=diameter_m,
        pairs=pairs,
    )
