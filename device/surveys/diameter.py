"""The diameter survey: Measure, and a second position where the pipe is wide; the surer recording counts."""

from __future__ import annotations

import logging
import time
from typing import Any

from device.bus import Bus
from device.clouds import cloud_json
from device.errors import EstimateFailed
from device.feed import CameraFeed
from device.pictures import frame_jpeg
from device.prompts import PROMPTS
from device.store import NewRecording, Store
from device.surveys.base import Job, Outcome, Survey
from device.surveys.diameter_result import PipeContext, Result, choose, diameter_result
from device.surveys.live import LiveEstimates
from device.surveys.recording import Recording
from device.workers import WorkerPool
from drivers.depth.base import STEREO_SCALE_STD
from estimators.picture import picture_quality

log = logging.getLogger(__name__)

_COMPUTING_LIMIT_S = 60.0
_TICK_S = 0.1


class DiameterSurvey(Survey):
    """The paper's section 4.2: a recording of each camera, judged by itself; the one with the smaller radius std is taken."""

    kind = "diameter"

    def __init__(self, store: Store, bus: Bus, feeds: list[CameraFeed], pool: WorkerPool, live: LiveEstimates) -> None:
        super().__init__(store, bus)
        self._feeds = feeds
        self._pool = pool
        self._live = live

    def _measure(self, job: Job) -> Outcome:
        self._live.pause(True)
        recordings = [Recording(feed, self._pool, job.frames, self._live.add) for feed in self._feeds]
        try:
            self._progress(job, "measuring", 0)
            self._collect(job, recordings)
            complete = [recording for recording in recordings if not recording.lost]
            if not complete:
                return self._no_picture(job, recordings)
            done = self._state["frames_done"]
            self._progress(job, "computing", done)
            self._wait_for_estimates(complete)
            return self._conclude(job, recordings)
        finally:
            for recording in recordings:
                recording.cancel()
            self._live.pause(False)

    def _collect(self, job: Job, recordings: list[Recording]) -> None:
        told = 0
        while any(recording.collecting for recording in recordings):
            self._check_cancelled()
            done = min((recording.done for recording in recordings if not recording.lost), default=0)
            if done != told:
                told = done
                self._progress(job, "measuring", done)
            time.sleep(_TICK_S)
        self._set(job, "measuring", min((recording.done for recording in recordings if not recording.lost), default=told))

    def _wait_for_estimates(self, recordings: list[Recording]) -> None:
        deadline = time.monotonic() + _COMPUTING_LIMIT_S
        while any(recording.computing for recording in recordings):
            self._check_cancelled()
            if time.monotonic() > deadline:
                raise EstimateFailed("The box could not compute the result in time: measure again.")
            time.sleep(_TICK_S / 10)

    def _conclude(self, job: Job, recordings: list[Recording]) -> Outcome:
        found = [self._judge(job, recording) for recording in recordings if not recording.lost]
        results = [recording.result for recording in found]
        if job.continues:
            results += [recording["result"] for recording in self._store.surveys.get(job.survey_id)["recordings"]]
        conclusion = choose(results)
        gone = [recording.feed.name for recording in recordings if recording.lost]
        if gone:
            text = f"The camera {' and '.join(gone)} was lost and has no part in this result."
            conclusion = {**conclusion, "warnings": [*conclusion["warnings"], {"code": "camera_lost", "text": text}]}
        self._check_cancelled()
        self._store.surveys.conclude(job.survey_id, "saved", found, conclusion)
        return Outcome("saved", "", conclusion)

    def _judge(self, job: Job, recording: Recording) -> NewRecording:
        pipe = job.pipe or {}
        kept = recording.kept
        context = PipeContext(
            material=pipe.get("material"),
            reference_dn=pipe.get("reference_dn"),
            position=job.position,
            ask_second_position=True,
            scale_std=STEREO_SCALE_STD if kept is None else kept[0].scale_std,
        )
        color = None if kept is None else kept[0].color
        result = diameter_result(recording.estimates, context, None if color is None else picture_quality(color))
        settings: dict[str, Any] = {"frames_wanted": job.frames, "estimates_failed": recording.failed}
        if kept is not None:
            settings |= {
                "source": kept[0].source,
                "width": kept[0].intrinsics.width,
                "height": kept[0].intrinsics.height,
                "depth_unit_m": kept[0].depth_unit_m,
            }
        return NewRecording(
            camera=recording.feed.name,
            position=job.position,
            frames=len(recording.estimates),
            result={**result, "camera": recording.feed.name},
            cloud=None if kept is None else cloud_json(*kept),
            settings=settings,
            picture_color=None if kept is None else frame_jpeg("color", kept[0]),
            picture_depth=None if kept is None else frame_jpeg("depth", kept[0]),
        )

    def _no_picture(self, job: Job, recordings: list[Recording]) -> Outcome:
        """A measurement without a picture is a finding too: it says why. In a second position the first one stays as it was."""
        blind = bool(recordings) and all(recording.feed.blind for recording in recordings)
        lost = no_picture("few_points" if blind else "camera_lost", job.position, recordings[0].feed.name if recordings else "")
        message = lost["prompts"][0]["reason"]
        if job.continues:
            self._store.surveys.abandon(job.survey_id)
        else:
            self._store.surveys.conclude(job.survey_id, "failed", [], lost)
        return Outcome("failed", message, lost)


def no_picture(code: str, position: str | None, camera: str) -> Result:
    """The RESULT of a recording that never came to be, for the reason ``code``."""
    nothing = diameter_result([], PipeContext(position=position))
    return {**nothing, "verdict": "retry", "reasons": [code], "prompts": [PROMPTS[code].to_json()], "camera": camera}
