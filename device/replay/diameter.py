"""A measurement computed again: the same frames with the same seeds through the same workers, judged the same way."""

from __future__ import annotations

from collections import deque
from concurrent.futures import Future
from typing import Any

from device.diameter.judging import Ended, conclude, judge, nothing_seen
from device.diameter.take import Take
from device.errors import DeviceError
from device.recorder.reader import Entry
from device.recorder.schemas import topic_name
from device.surveys.topics import ENDED, ESTIMATES, FRAMES
from device.workers import WorkerPool
from drivers.depth.base import DepthFrame
from estimators.frame import FrameEstimate

_Job = tuple[str, int, DepthFrame, Future[FrameEstimate]]


class DiameterReplay:
    """``head`` as ``surveys.diameter`` writes it."""

    def __init__(self, head: dict[str, Any], workers: int) -> None:
        self.missing = self.frames = 0
        self._head = head
        self._topics = {topic_name("camera", name): name for name in head["cameras"]}
        self._takes = {name: Take() for name in head["cameras"]}
        self._seen: dict[str, deque[DepthFrame]] = {name: deque() for name in head["cameras"]}
        self._chosen: dict[tuple[str, int], tuple[DepthFrame | None, int]] = {}
        self._jobs: deque[_Job] = deque()
        self._ended: list[Ended] = []
        self._most_jobs = 2 * workers
        self._pool = WorkerPool(workers)

    def take(self, entry: Entry) -> str | None:
        """Frames wait until it is noted that they were estimated, and then for what came of it."""
        sample = entry.sample
        if isinstance(sample, DepthFrame) and entry.topic in self._topics:
            self._seen[self._topics[entry.topic]].append(sample)
        elif entry.topic == FRAMES and isinstance(sample, dict):
            frame = self._find(sample["camera"], sample["monotonic_ns"])
            self.missing += frame is None
            self._chosen[sample["camera"], sample["seed"]] = frame, sample["resamples"]
        elif entry.topic == ESTIMATES and isinstance(sample, dict):
            return self._estimate(sample["camera"], sample["seed"], bool(sample.get("failed")))
        elif entry.topic == ENDED and isinstance(sample, dict):
            self._ended = [Ended(**camera) for camera in sample["cameras"]]
        return None

    def finish(self) -> dict[str, Any]:
        """Whatever was begun is estimated, also where the log ends before its estimate."""
        for camera, seed in list(self._chosen):
            self._estimate(camera, seed, failed=False)
        while self._jobs:
            self._collect()
        ended = self._ended or [Ended(name, lost=False) for name in self._head["cameras"]]
        there = [one.camera for one in ended if not one.lost]
        if not there:
            return {"state": "failed", "results": [], "conclusion": nothing_seen(ended, self._head["position"])}
        results = []
        for camera in there:
            take = self._takes[camera]
            kept = None if take.kept is None else take.kept[0]
            results.append(judge(camera, take, kept, self._head["pipe"], self._head["position"]))
        return {"state": "saved", "results": results, "conclusion": conclude(results, self._head["earlier"], ended)}

    def close(self) -> None:
        """End the workers."""
        self._pool.close()

    def _find(self, camera: str, monotonic_ns: int) -> DepthFrame | None:
        """The frame of that moment; those before it were never estimated."""
        waiting = self._seen[camera]
        while waiting and waiting[0].monotonic_ns < monotonic_ns:
            waiting.popleft()
        return waiting.popleft() if waiting and waiting[0].monotonic_ns == monotonic_ns else None

    def _estimate(self, camera: str, seed: int, failed: bool) -> str | None:
        frame, resamples = self._chosen.pop((camera, seed), (None, 0))
        if frame is None or failed:
            self._takes[camera].add(seed, None)
            return None
        self.frames += 1
        future = self._pool.submit(frame.depth, frame.intrinsics, frame.depth_unit_m, seed, resamples)
        self._jobs.append((camera, seed, frame, future))
        return self._collect() if len(self._jobs) >= self._most_jobs else None

    def _collect(self) -> str | None:
        camera, seed, frame, future = self._jobs.popleft()
        try:
            estimate = future.result()
        except DeviceError:
            self.missing += 1
            self._takes[camera].add(seed, None)
            return f"{camera}, frame {frame.number}: no estimate"
        self._takes[camera].add(seed, (frame, estimate))
        diameter = estimate.diameter
        return f"{camera}, frame {frame.number}: {'no pipe' if diameter is None else f'{1000 * diameter:.2f} mm'}"
