"""The anomaly survey: a few pairs of the present view, inspected one after the other; what most of them say is the finding."""

from __future__ import annotations

import logging
import time
import zlib
from concurrent.futures import CancelledError
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from device.anomaly.calibration import RigSource
from device.anomaly.live import LIMIT_S, AnomalyLive, PairWorker
from device.anomaly.rig import StereoEye
from device.anomaly.scan import concluded, refused
from device.anomaly.work import Inspected
from device.bus import Bus
from device.errors import EstimateFailed
from device.pictures import encode_jpeg, in_colour
from device.recorder import Recorder, Shelf
from device.recorder.samples import Words, picture
from device.recorder.schemas import topic_name
from device.recorder.versions import versions
from device.store import NewRecording, Store
from device.surveys.base import Cancelled, Job, Outcome, Survey
from device.surveys.topics import FINDINGS, PAIRS, PROMPTED
from drivers.grabber.base import VideoFrame
from drivers.stereo.base import StereoFrame

log = logging.getLogger(__name__)

SILENCE_S = 15.0
"""The camera may have to be started first."""
_TICK_S = 0.1
_MOVED = 0.12
"""Change between two pictures, as a share of their contrast, from which the camera moved: noise alone makes 0.01."""
_THUMBNAIL = (96, 60)
Picture = NDArray[np.uint8]


class AnomalySurvey(Survey):
    """Scans the present view of one stereo camera."""

    kind = "anomaly"

    def __init__(self, store: Store, bus: Bus, eye: StereoEye, worker: PairWorker, live: AnomalyLive, shelf: Shelf) -> None:
        super().__init__(store, bus)
        self._eye = eye
        self._worker = worker
        self._live = live
        self._shelf = shelf

    def _measure(self, job: Job) -> Outcome:
        recorder = self._shelf.begin(job.survey_id, self._head(job))
        wanted = True
        self._live.pause(True)
        try:
            self._progress(job, "measuring", 0)
            frames = self._collect(job, recorder)
            camera = self._eye.feed.name
            found: list[Inspected] = []
            chosen = None
            if not frames:
                result = refused("pair_lost", camera, 0, job.chainage)
            elif moved([frame.left for frame in frames]):
                result = refused("pair_moved", camera, len(frames), job.chainage)
            else:
                found = self._inspect(job, frames)
                result, chosen = concluded([one.result for one in found], camera, job.chainage)
            self._check_cancelled()
            outcome = self._keep(job, frames, found, result, chosen)
            for prompt in result["prompts"]:
                recorder.write(PROMPTED, Words(prompt["code"], f"{prompt['reason']} {prompt['remedy']}"))
            recorder.write(FINDINGS, {"state": outcome.state, "result": result})
            return outcome
        except Cancelled:
            wanted = False
            raise
        finally:
            recorder.close(discard=not wanted, wait_s=0.0)
            self._live.pause(False)

    def _head(self, job: Job) -> dict[str, Any]:
        """What a replay has to know."""
        return {
            "kind": self.kind,
            "versions": versions(),
            "pipe": job.pipe,
            "chainage_m": job.chainage,
            "camera": self._eye.feed.name,
        }

    def _collect(self, job: Job, recorder: Recorder) -> list[StereoFrame]:
        """The pairs, recorded as they come; fewer where the camera falls silent. A recording in place of a camera has one pair
        at a time."""
        feed = self._eye.feed
        frames: list[StereoFrame] = []
        wanted = 1 if feed.recorded else job.frames
        seen: set[int] = set()
        heard = time.monotonic()
        tap = feed.tap(2)
        try:
            while len(frames) < wanted:
                self._check_cancelled()
                frame = tap.get(_TICK_S)
                if frame is None:
                    if time.monotonic() - heard > SILENCE_S:
                        return []
                    continue
                heard = time.monotonic()
                print_of = zlib.crc32(np.ascontiguousarray(frame.left).data)
                if print_of in seen:
                    continue
                seen.add(print_of)
                record_pair(recorder, feed.name, frame, self._eye.source)
                frames.append(frame)
                self._progress(job, "measuring", len(frames))
        finally:
            tap.close()
        return frames

    def _inspect(self, job: Job, frames: list[StereoFrame]) -> list[Inspected]:
        found = []
        for number, frame in enumerate(frames):
            self._progress(job, "computing", number)
            future = self._worker.give(True, frame.left, frame.right, self._eye.source.rig(frame))
            deadline = time.monotonic() + 2.5 * LIMIT_S
            while not future.done():
                try:
                    self._check_cancelled()
                except Cancelled:
                    future.cancel()
                    raise
                if time.monotonic() > deadline:
                    raise EstimateFailed("The box could not compute the result in time: scan again.")
                time.sleep(_TICK_S / 2)
            try:
                found.append(future.result())
            except CancelledError:
                raise EstimateFailed("The estimate did not come back from the computing process.") from None
        self._set(job, "computing", len(frames))
        return found

    def _keep(
        self, job: Job, frames: list[StereoFrame], found: list[Inspected], result: dict[str, Any], chosen: int | None
    ) -> Outcome:
        """Durable, then told."""
        recordings = []
        if frames:
            frame = frames[chosen or 0]
            views = None if chosen is None else found[chosen].views
            recordings.append(
                NewRecording(
                    camera=result["camera"],
                    position=None,
                    frames=result["frames"],
                    result=result,
                    cloud=None if views is None else views.cloud,
                    settings={
                        "pairs_wanted": job.frames,
                        "source": frame.source,
                        "width": frame.intrinsics.width,
                        "height": frame.intrinsics.height,
                        "baseline_m": frame.baseline_m,
                        "calibrated": self._eye.source.calibration is not None,
                    },
                    picture_color=reference_jpeg(frame.left) if views is None else views.reference,
                    overlay=None if views is None else views.overlay,
                    map=None if views is None else views.map,
                )
            )
        state = "saved" if recordings else "failed"
        self._store.surveys.conclude(job.survey_id, state, recordings, result)
        message = "" if recordings else result["prompts"][0]["reason"]
        return Outcome(state, message, result)


def reference_jpeg(left: Picture) -> bytes:
    """The left picture for the page."""
    return encode_jpeg(in_colour(left))


def moved(pictures: list[Picture]) -> bool:
    """Whether the camera moved between any two pictures in a row."""
    small = [cv2.resize(one, _THUMBNAIL, interpolation=cv2.INTER_AREA).astype(np.float32) for one in pictures]
    even = [one - one.mean() for one in small]
    contrast = max(float(np.mean([one.std() for one in even])), 1.0)
    return any(float(np.abs(b - a).mean()) > _MOVED * contrast for a, b in pairwise(even))


def record_pair(recorder: Recorder, camera: str, frame: StereoFrame, source: RigSource) -> None:
    """Both pictures, without loss, and what they are read with."""
    for side, image in (("left", frame.left), ("right", frame.right)):
        taken = VideoFrame(in_colour(image), frame.monotonic_ns, frame.number, None, frame.source)
        recorder.write(topic_name("stereo", camera, side), picture(taken, lossless=True))
    rig = source.rig(frame)
    recorder.write(
        PAIRS,
        {
            "camera": camera,
            "number": frame.number,
            "monotonic_ns": frame.monotonic_ns,
            "intrinsics": vars(rig.intrinsics),
            "baseline_m": rig.baseline_m,
            "offset_px": rig.offset_px,
            "offset_std_px": rig.offset_std_px,
            "scale_std": rig.scale_std,
            "known_shift_px": rig.known_shift_px,
        },
    )
