"""From the takes of all cameras to the finding: what the survey does with its pictures, and what a replay does again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from device.diameter.result import PipeContext, Result, choose, diameter_result
from device.diameter.take import Take
from device.prompts import PROMPTS
from drivers.depth.base import STEREO_SCALE_STD, DepthFrame
from estimators.picture import picture_quality


@dataclass(frozen=True)
class Ended:
    """How a camera's recording ended: ``lost`` before there was enough of it; ``blind``: it worked and saw nothing."""

    camera: str
    lost: bool
    blind: bool = False


def judge(camera: str, take: Take, kept: DepthFrame | None, pipe: dict[str, Any] | None, position: str) -> Result:
    """The RESULT of one camera. ``kept`` is the frame to show, its colour as it is recorded."""
    context = PipeContext(
        material=(pipe or {}).get("material"),
        reference_dn=(pipe or {}).get("reference_dn"),
        position=position,
        ask_second_position=True,
        scale_std=STEREO_SCALE_STD if kept is None else kept.scale_std,
    )
    color = None if kept is None else kept.color
    result = diameter_result(take.estimates, context, None if color is None else picture_quality(color))
    return {**result, "camera": camera}


def conclude(results: Sequence[Result], earlier: Sequence[Result], ended: Sequence[Ended]) -> Result:
    """The finding of the survey from its cameras' results and those of ``earlier`` positions."""
    conclusion = choose([*results, *earlier])
    gone = [one.camera for one in ended if one.lost]
    if gone:
        text = f"The camera {' and '.join(gone)} was lost and has no part in this result."
        conclusion = {**conclusion, "warnings": [*conclusion["warnings"], {"code": "camera_lost", "text": text}]}
    return conclusion


def nothing_seen(ended: Sequence[Ended], position: str) -> Result:
    """The finding where no camera had enough: it says why."""
    blind = bool(ended) and all(one.blind for one in ended)
    return no_picture("few_points" if blind else "camera_lost", position, ended[0].camera if ended else "")


def no_picture(code: str, position: str | None, camera: str) -> Result:
    """The RESULT of a recording that never came to be, for the reason ``code``."""
    nothing = diameter_result([], PipeContext(position=position))
    return {**nothing, "verdict": "retry", "reasons": [code], "prompts": [PROMPTS[code].to_json()], "camera": camera}
