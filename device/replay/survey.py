"""A recorded survey computed again from what was recorded of it, and compared with what it found then."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from device.errors import Invalid
from device.recorder.reader import HEAD_TOPIC, Entry, Recording, open_recording
from device.recorder.versions import versions
from device.replay.compare import Difference, differences, plain_json
from device.surveys.topics import FINDINGS


class Replay(Protocol):
    """One kind of survey, computed again. ``missing`` counts what it had consumed that is not in the recording."""

    missing: int
    frames: int

    def take(self, entry: Entry) -> str | None:
        """The next sample; what came of it in one line, where something did."""

    def finish(self) -> dict[str, Any]:
        """No more will come: the findings, JSON-ready."""

    def close(self) -> None:
        """Free what it holds. May be called twice."""


@dataclass(frozen=True)
class Options:
    """``model`` for the detector instead of the shipped ones; ``recorded_detections``: what the detector said then is taken
    from the log, whether or not it can be asked again; ``workers`` processes for estimates."""

    model: Path | None = None
    recorded_detections: bool = False
    workers: int = 2


@dataclass(frozen=True)
class Outcome:
    """``findings`` computed again; ``logged`` those of the survey, None where it did not come so far. ``exact``: everything
    that the survey consumed was there. ``versions`` that differ: name, then, now."""

    kind: str
    survey_id: int
    findings: dict[str, Any]
    logged: dict[str, Any] | None
    differences: list[Difference]
    exact: bool
    missing: int
    frames: int
    versions: dict[str, tuple[str, str]]
    recorded_s: float
    replay_s: float

    @property
    def equal(self) -> bool | None:
        """Bit for bit; None where there is nothing to compare with."""
        return None if self.logged is None else not self.differences

    @property
    def within_tolerance(self) -> bool | None:
        """What can be asked for on another machine, or with other versions."""
        return None if self.logged is None else all(found.tolerable for found in self.differences)

    def to_json(self) -> dict[str, Any]:
        """For ``borescout replay --json``."""
        return {
            "kind": self.kind,
            "survey_id": self.survey_id,
            "findings": self.findings,
            "equal": self.equal,
            "within_tolerance": self.within_tolerance,
            "differences": [vars(found) for found in self.differences],
            "exact": self.exact,
            "missing": self.missing,
            "frames": self.frames,
            "versions_differ": {name: list(pair) for name, pair in self.versions.items()},
            "recorded_s": round(self.recorded_s, 2),
            "replay_s": round(self.replay_s, 2),
        }


def replay(path: Path, options: Options | None = None, after_step: Callable[[str], object] = lambda line: None) -> Outcome:
    """Compute the survey in ``path`` again; ``after_step`` is told of each frame. Raises Invalid with one sentence."""
    recording = open_recording(path)
    survey = _survey(recording, options or Options())
    logged: dict[str, Any] | None = None
    begun = time.monotonic()
    first_ns = last_ns = None
    try:
        for entry in recording.entries():
            if entry.topic == FINDINGS and isinstance(entry.sample, dict):
                logged = entry.sample
            elif entry.topic != HEAD_TOPIC:
                first_ns, last_ns = first_ns or entry.log_ns, entry.log_ns
                line = survey.take(entry)
                if line is not None:
                    after_step(line)
        findings = plain_json(survey.finish())
    finally:
        survey.close()
    then, now = recording.head.get("versions") or {}, versions()
    return Outcome(
        kind=recording.head["kind"],
        survey_id=recording.head["survey_id"],
        findings=findings,
        logged=logged,
        differences=[] if logged is None else differences(logged, findings),
        exact=survey.missing == 0,
        missing=survey.missing,
        frames=survey.frames,
        versions={name: (then.get(name, ""), now[name]) for name in now if then.get(name, "") != now[name]},
        recorded_s=0.0 if first_ns is None or last_ns is None else (last_ns - first_ns) / 1e9,
        replay_s=time.monotonic() - begun,
    )


def _survey(recording: Recording, options: Options) -> Replay:
    kind = recording.head.get("kind")
    if kind == "diameter":
        from device.replay.diameter import DiameterReplay

        return DiameterReplay(recording.head, options.workers)
    if kind == "landmarks":
        from device.replay.drive import DriveReplay

        return DriveReplay(recording.head, options.model, options.recorded_detections)
    if kind == "anomaly":
        from device.replay.anomaly import AnomalyReplay

        return AnomalyReplay(recording.head)
    if kind == "structure":
        from device.replay.structure import StructureReplay

        return StructureReplay(recording.head)
    raise Invalid(f"A survey of the kind {kind!r} cannot be computed again by this program.")
