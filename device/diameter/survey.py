"""The diameter survey: Measure, and a second position where the pipe is wide; the surer recording counts."""

from __future__ import annotations

import logging
import time
from functools import partial
from typing import Any

from device.bus import Bus
from device.diameter.clouds import cloud_json
from device.diameter.judging import Ended, conclude, judge, nothing_seen
from device.diameter.live import LiveEstimates
from device.diameter.recording import Recording
from device.diameter.result import Result
from device.errors import EstimateFailed
from device.feeds.feed import CameraFeed
from device.pictures import frame_jpeg
from device.recorder import Shelf
from device.recorder.samples import Words, as_recorded
from device.recorder.schemas import topic_name
from device.recorder.versions import versions
from device.store import NewRecording, Store
from device.surveys.base import Cancelled, Job, Outcome, Survey
from device.surveys.topics import ENDED, FINDINGS, PROMPTED
from device.workers import WorkerPool

log = logging.getLogger(__name__)

_COMPUTING_LIMIT_S = 60.0
_TICK_S = 0.1


class DiameterSurvey(Survey):
    """The paper's section 4.2: a recording of each camera, judged by itself; the one with the smaller radius std is taken."""

    kind = "diameter"

    def __init__(
        self, store: Store, bus: Bus, feeds: list[CameraFeed], pool: WorkerPool, live: LiveEstimates, shelf: Shelf
    ) -> None:
        super().__init__(store, bus)
        self._shelf = shelf
        self._feeds = feeds
        self._pool = pool
        self._live = live

    def _measure(self, job: Job) -> Outcome:
        recorder = self._shelf.begin(job.survey_id, self._head(job))
        followers = [feed.follow(partial(recorder.write, topic_name("camera", feed.name))) for feed in self._feeds]
        recordings = [Recording(feed, self._pool, job.frames, self._live.add, recorder.write) for feed in self._feeds]
        wanted = True
        self._live.pause(True)
        try:
            self._progress(job, "measuring", 0)
            self._collect(job, recordings)
            for follower in followers:
                follower.close()
            complete = [recording for recording in recordings if not recording.lost]
            ended = [Ended(recording.feed.name, recording.lost, recording.feed.blind) for recording in recordings]
            recorder.write(ENDED, {"cameras": [vars(one) for one in ended]})
            if complete:
                done = self._state["frames_done"]
                self._progress(job, "computing", done)
                self._wait_for_estimates(complete)
                outcome, findings = self._conclude(job, complete, ended)
            else:
                outcome, findings = self._no_picture(job, ended)
            for prompt in outcome.conclusion["prompts"]:
                recorder.write(PROMPTED, Words(prompt["code"], f"{prompt['reason']} {prompt['remedy']}"))
            recorder.write(FINDINGS, findings)
            return outcome
        except Cancelled:
            wanted = False
            raise
        finally:
            for follower in followers:
                follower.close()
            for recording in recordings:
                recording.cancel()
            recorder.close(discard=not wanted, wait_s=0.0)
            self._live.pause(False)

    def _head(self, job: Job) -> dict[str, Any]:
        """What a replay has to know."""
        return {
            "kind": self.kind,
            "versions": versions(),
            "pipe": job.pipe,
            "position": job.position,
            "frames": job.frames,
            "earlier": self._earlier(job),
            "cameras": [feed.name for feed in self._feeds],
        }

    def _earlier(self, job: Job) -> list[Result]:
        """The results of this survey's earlier positions."""
        if not job.continues:
            return []
        return [recording["result"] for recording in self._store.surveys.get(job.survey_id)["recordings"]]

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

    def _conclude(self, job: Job, recordings: list[Recording], ended: list[Ended]) -> tuple[Outcome, dict[str, Any]]:
        found = [self._judge(job, recording) for recording in recordings]
        results = [recording.result for recording in found]
        conclusion = conclude(results, self._earlier(job), ended)
        self._check_cancelled()
        self._store.surveys.conclude(job.survey_id, "saved", found, conclusion)
        return Outcome("saved", "", conclusion), {"state": "saved", "results": results, "conclusion": conclusion}

    def _judge(self, job: Job, recording: Recording) -> NewRecording:
        take = recording.take
        kept = None if take.kept is None else (as_recorded(take.kept[0]), take.kept[1])
        result = judge(recording.feed.name, take, None if kept is None else kept[0], job.pipe, job.position)
        settings: dict[str, Any] = {"frames_wanted": job.frames, "estimates_failed": take.failed}
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
            frames=len(take.estimates),
            result=result,
            cloud=None if kept is None else cloud_json(*kept),
            settings=settings,
            picture_color=None if kept is None else frame_jpeg("color", kept[0]),
            picture_depth=None if kept is None else frame_jpeg("depth", kept[0]),
        )

    def _no_picture(self, job: Job, ended: list[Ended]) -> tuple[Outcome, dict[str, Any]]:
        """A measurement without a picture is a finding too: it says why. In a second position the first one stays as it was."""
        lost = nothing_seen(ended, job.position)
        if job.continues:
            self._store.surveys.abandon(job.survey_id)
        else:
            self._store.surveys.conclude(job.survey_id, "failed", [], lost)
        return Outcome("failed", lost["prompts"][0]["reason"], lost), {"state": "failed", "results": [], "conclusion": lost}
