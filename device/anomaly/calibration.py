"""The calibration file of a stereo rig: what a known pipe, or a chessboard, told of it. JSON, read and written here alone."""

from __future__ import annotations

import json
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from device.errors import Invalid
from drivers.stereo.base import StereoFrame
from estimators.stereo.known_pipe import KnownPipe
from estimators.stereo.rig import StereoRig


class KnownPipeCalibration(BaseModel):
    """Offset and scale from a pipe of known diameter. Pixels are those of pictures ``width`` wide."""

    model_config = ConfigDict(extra="forbid")

    kind: str = Field(default="known_pipe", pattern="^known_pipe$")
    width: int = Field(gt=0)
    offset_px: float
    offset_std_px: float = Field(ge=0)
    scale: float = Field(gt=0.5, lt=2.0)
    scale_std: float = Field(ge=0)
    shift_px: float = Field(gt=0)
    diameter_m: float = Field(gt=0)
    pairs: list[str]


def save_calibration(path: Path, calibration: BaseModel) -> None:
    """Write the file whole or not at all."""
    draft = path.with_name(path.name + ".part")
    try:
        draft.write_text(calibration.model_dump_json(indent=2) + "\n", encoding="utf-8")
        os.replace(draft, path)
    except OSError as error:
        raise Invalid(f"The calibration cannot be written to {path}: {error.strerror or error}.") from error


def load_calibration(path: Path) -> KnownPipeCalibration:
    """Read a file that ``save_calibration`` wrote. Raises Invalid."""
    try:
        found: Any = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise Invalid(f"The calibration {path} cannot be read: {error.strerror or error}.") from error
    except (ValueError, RecursionError) as error:
        raise Invalid(f"The calibration {path} is no JSON: {error}.") from error
    try:
        return KnownPipeCalibration.model_validate(found)
    except ValidationError as error:
        first = error.errors()[0]
        where = ".".join(str(part) for part in first["loc"]) or "file"
        raise Invalid(f"The calibration {path} is not one of a known pipe: {where}: {first['msg']}.") from error


@dataclass(frozen=True)
class RigSource:
    """Makes the rig of a frame: what the camera states, corrected by a calibration where there is one."""

    calibration: KnownPipeCalibration | None = None

    def rig(self, frame: StereoFrame) -> StereoRig:
        """The rig to read this frame with. Raises Invalid where the calibration is of other pictures."""
        found = self.calibration
        if found is None:
            return StereoRig(frame.intrinsics, frame.baseline_m, frame.offset_px)
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
