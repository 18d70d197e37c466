"""``borescout map``: the landmarks survey in the terminal, on a recording, on the crawler, or on a table of detections."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import click

from device.errors import Invalid
from device.json_text import dumps
from device.landmarks.as_json import landmark_json
from device.landmarks.detections_file import read_detections, read_rig
from device.landmarks.detectors import EVERY, Detector
from device.landmarks.drive_faults import FaultWatch
from device.landmarks.output import print_map
from device.landmarks.picture import save_map_picture
from device.landmarks.pipeline import LEAST_RATE, LandmarkPipeline, PipelineSetup
from device.landmarks.recorded_way import RecordedWay, recorded_way
from device.prompts import PROMPTS
from drivers.base import EndOfRecording, RecordingBroken
from drivers.encoder.osd import OsdReader, read_series, require_distance
from drivers.encoder.recorded import read_distances
from drivers.grabber.base import FrameGrabber, VideoFrame
from drivers.registry import ENCODERS, open_grabber
from estimators.landmarks.from_detections import map_detections, way_of

SERIAL = tuple(kind for kind in ENCODERS if kind not in ("csv", "virtual"))
OSD_EVERY_S = 0.2
"""The distance is read five times a second: no counter turns faster."""

Map = dict[str, Any]


@click.command("map")
@click.option("--virtual", is_flag=True, help="A crawler in the virtual sewer.")
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True, help="With --virtual: which drive.")
@click.option("--video", type=click.Path(path_type=Path), help="An inspection video.")
@click.option("--stills", type=click.Path(path_type=Path), help="A folder of stills named by milliseconds.")
@click.option("--grabber", help="A CCTV grabber (/dev/video0) or a stream (rtsp://...), live; Ctrl-C ends the drive.")
@click.option("--detections", type=click.Path(path_type=Path), help="A CSV of detections; goes with --rig.")
@click.option("--rig", type=click.Path(path_type=Path), help="JSON of the rig that made the detections.")
@click.option("--encoder", type=click.Choice(SERIAL), help="With --grabber: the tether encoder.")
@click.option("--port", help="Its serial port.")
@click.option("--baud", type=int, help="Its baud rate, where it is not the usual one.")
@click.option("--pattern", help="With --encoder pattern: a regular expression with a group named distance or count.")
@click.option("--counts-per-metre", type=float, default=1.0, show_default=True, help="Counts of the encoder to a metre.")
@click.option("--osd", is_flag=False, flag_value="auto", help="Read the burned-in distance; X,Y,W,H or auto says where.")
@click.option("--distance-csv", type=click.Path(path_type=Path), help="A CSV with time_s (or frame) and distance_m.")
@click.option("--radius", type=float, help="Interior radius of the pipe (m).")
@click.option("--focal", type=(float, float), help="Focal lengths fx fy (px).")
@click.option("--centre", type=(float, float), help="Principal point (px); the middle of the picture if not given.")
@click.option("--focal-radius", type=float, help="f * R (px m), where focal length and radius are not known apart.")
@click.option("--every", type=click.IntRange(1, 100), default=EVERY, show_default=True, help="Pictures to a look.")
@click.option("--length", type=float, help="Way from the first frame to the last (m), such as from node to node.")
@click.option("--picture", type=click.Path(path_type=Path, dir_okay=False), help="Save the unrolled map here (.png).")
@click.option("--json", "as_json", is_flag=True, help="One JSON object instead of a table.")
def map_pipe(**options: Any) -> int:
    """Map a pipe: what lies where."""
    wanted = Options(**options)
    wanted.check()
    begun = time.monotonic()
    if wanted.grabber is not None:
        from device.landmarks.live_command import map_live  # threads and ports, which a recording does without

        found = map_live(wanted)
    else:
        found = map_source(wanted)
    found["seconds"] = round(time.monotonic() - begun, 3)
    if wanted.picture is not None:
        save_map_picture(wanted.picture, found)
    if wanted.as_json:
        click.echo(dumps(found))
    else:
        print_map(found)
    return 0


@dataclass(frozen=True)
class Options:
    """The command line."""

    virtual: bool = False
    seed: int = 1
    video: Path | None = None
    stills: Path | None = None
    grabber: str | None = None
    detections: Path | None = None
    rig: Path | None = None
    encoder: str | None = None
    port: str | None = None
    baud: int | None = None
    pattern: str | None = None
    counts_per_metre: float = 1.0
    osd: str | None = None
    distance_csv: Path | None = None
    radius: float | None = None
    focal: tuple[float, float] | None = None
    centre: tuple[float, float] | None = None
    focal_radius: float | None = None
    length: float | None = None
    picture: Path | None = None
    as_json: bool = False
    every: int = EVERY

    def check(self) -> None:
        """Raises Invalid for what does not go together."""
        sources = {
            "--virtual": self.virtual,
            "--video": self.video is not None,
            "--stills": self.stills is not None,
            "--grabber": self.grabber is not None,
            "--detections": self.detections is not None,
        }
        named = [name for name, given in sources.items() if given]
        if len(named) != 1:
            choice = "--virtual, --video, --stills, --grabber or --detections"
            raise Invalid(f"Choose one of {choice}." if named else f"Say what to map: {choice}.")
        source = named[0]
        for given, option, goes_with in (
            (self.rig is not None, "--rig", ("--detections",)),
            (self.encoder is not None, "--encoder", ("--grabber",)),
            (self.distance_csv is not None, "--distance-csv", ("--video", "--stills")),
            (self.osd is not None, "--osd", ("--video", "--stills", "--grabber")),
        ):
            if given and source not in goes_with:
                raise Invalid(f"The option {option} goes with {' or '.join(goes_with)}.")
        if sum((self.encoder is not None, self.osd is not None, self.distance_csv is not None)) > 1:
            raise Invalid("Choose one of --encoder, --osd and --distance-csv.")
        if self.detections is not None and self.rig is None:
            raise Invalid("The option --detections needs --rig: fx, fy, cx, cy, radius_m, width and height as JSON.")
        if self.encoder is not None and not self.port:
            raise Invalid("Say with --port where the encoder is plugged in.")
        if self.grabber is not None and self.encoder is None and self.osd is None:
            raise Invalid("Say what tells the distance: --encoder with --port, or --osd.")
        for name in ("radius", "focal_radius", "length", "counts_per_metre"):
            value = getattr(self, name)
            if value is not None and not 0 < value < 1e9:
                raise Invalid(f"The option --{name.replace('_', '-')} takes a positive number, not {value:g}.")
        if self.focal is not None and min(self.focal) <= 0:
            raise Invalid("The option --focal takes two positive numbers.")

    def setup(self) -> PipelineSetup:
        """What is known before the drive."""
        return PipelineSetup(self.focal, self.centre, self.radius, self.focal_radius)

    def region(self) -> tuple[int, int, int, int] | None:
        """Where the burned-in distance is looked for. Raises Invalid."""
        if self.osd in (None, "auto"):
            return None
        assert self.osd is not None
        try:
            x, y, width, height = (int(part) for part in self.osd.split(","))
        except ValueError:
            raise Invalid(f"The option --osd takes X,Y,W,H in pixels or auto, not {self.osd}.") from None
        return x, y, width, height


def map_source(wanted: Options) -> Map:
    """The map of what lies there as a whole: a recording, the virtual drive, or a table of detections. Raises Invalid, or a
    DriverError that says what is missing."""
    return _recording(wanted) if wanted.detections is None else _from_detections(wanted)


def _from_detections(wanted: Options) -> Map:
    assert wanted.detections is not None  # check() saw to both
    assert wanted.rig is not None
    rig, rows = read_rig(wanted.rig), read_detections(wanted.detections)
    try:
        landmarks = map_detections(rows, rig)
    except ValueError as error:
        raise Invalid(f"The detections {wanted.detections} cannot be mapped: {error}") from None
    way = way_of(rows)
    faults = FaultWatch()
    for count, jump in enumerate(way.jumps, 1):
        faults.now(jump.time_s, jump.position)
        faults.jumps([(one.time_s, one.metres) for one in way.jumps[:count]])
    return {
        "landmarks": [landmark_json(number, landmark) for number, landmark in enumerate(landmarks, 1)],
        "rings": [],
        "focal_radius": {"value": rig.fx * rig.radius, "sigma": 0.0},
        "frames": len(set(rows.frame.tolist())),
        "from_m": float(way.shown.min()),
        "to_m": float(way.shown.max()),
        "smoothed": False,
        "faults": faults.untold(),
    }


def _recording(wanted: Options) -> Map:
    """A recording, or the virtual drive, from its first frame to its last."""
    if wanted.virtual:
        from device.landmarks.virtual_crawler import VirtualRun  # it draws in the whole virtual sewer

        run = VirtualRun(wanted.seed)
        return map_frames(run.frames(), run.frame_count, run.way(), run.setup(), run.detector(), wanted.length)
    from device.fcdd.detector import shipped_detector  # onnxruntime, which --help does without

    recording = _Recording(wanted)
    way = recording.way()
    setup = replace(wanted.setup(), sparse=recording.sparse)
    return map_frames(recording.frames(), recording.count, way, setup, shipped_detector(every=wanted.every), wanted.length)


class _Recording:
    """A video or a folder of stills, which can be played more than once."""

    def __init__(self, wanted: Options) -> None:
        self._wanted = wanted
        grabber = self._open()
        self.count, self._rate = grabber.frame_count, grabber.frame_rate
        if grabber.notice:
            warn(grabber.notice)
        grabber.close()

    @property
    def sparse(self) -> bool:
        """Whether its pictures are too far apart for flow."""
        return self._rate is not None and self._rate < LEAST_RATE

    def frames(self, say: bool = True) -> Iterator[VideoFrame]:
        """Every frame; one that cannot be read is passed over with a sentence."""
        grabber = self._open()
        try:
            while True:
                try:
                    yield grabber.read(5.0)
                except RecordingBroken as fault:
                    if say:
                        warn(str(fault))
        except EndOfRecording:
            return
        finally:
            grabber.close()

    def way(self) -> RecordedWay:
        """Where the crawler was. Raises Invalid, or a DriverError that says what is missing."""
        if self._wanted.distance_csv is not None:
            return self._from_csv(self._wanted.distance_csv)
        reader = OsdReader(self._wanted.region())
        require_distance(self.frames(say=False), reader)
        with progress("Reading the distance", self.count) as bar:
            series = read_series(_thinned(self.frames(say=False), bar), reader)
        told = [one for one in series.told if one.distance is not None]
        if len(told) < 2:
            raise Invalid("The distance was read in fewer than two frames: give the distances with --distance-csv FILE.")
        way = recorded_way(
            [one.time_s for one in told],
            [one.distance for one in told if one.distance is not None],
            pieces=[one.segment for one in told],
        )
        return way.longest()

    def _from_csv(self, path: Path) -> RecordedWay:
        series = read_distances(path)
        if series.times_s:
            times = list(series.times_s)
            distances = list(series.distances)
        else:
            moments = {frame.number - 1: frame.time_s for frame in self.frames(say=False)}
            pairs = [(moments[n], d) for n, d in zip(series.frames, series.distances, strict=True) if n in moments]
            if len(pairs) < 2:
                raise Invalid(f"The distances {path} are of frames that the recording does not have.")
            times, distances = [list(column) for column in zip(*pairs, strict=True)]
        return recorded_way(times, distances, series.quantum).longest()

    def _open(self) -> FrameGrabber:
        if self._wanted.video is not None:
            grabber = open_grabber("video", file=self._wanted.video)
        else:
            grabber = open_grabber("stills", folder=self._wanted.stills)
        grabber.open()
        return grabber


def map_frames(
    frames: Iterable[VideoFrame],
    count: int | None,
    way: RecordedWay,
    setup: PipelineSetup,
    detector: Detector,
    length: float | None,
) -> Map:
    """Frames with their positions through the pipeline to the map, with progress on stderr. Ctrl-C leaves nothing."""
    pipeline = LandmarkPipeline(setup, detector)
    faults = FaultWatch()
    first: float | None = None
    moment = 0.0
    with progress("Mapping", count) as bar:
        for frame in frames:
            first = frame.time_s if first is None else first
            moment = frame.time_s - first
            step = pipeline.step(frame, way.at(frame.time_s))
            faults.now(moment, None if step.position is None else step.position.chainage)
            faults.codes([code for code in step.prompts if code in PROMPTS])
            bar.update(1)
    if pipeline.frames == 0:
        raise Invalid("The recording has no frame that can be read.")
    for time_s, before, after in way.jumps:
        faults.now(time_s - (first or 0.0), before)
        faults.counter_set(before, after)
    return finished(pipeline, faults, moment, length)


def finished(pipeline: LandmarkPipeline, faults: FaultWatch, duration_s: float, length: float | None) -> Map:
    """The map once the drive is over, smoothed where that can be."""
    pipeline.finish()
    smoothed = pipeline.smooth(length)
    landmarks = pipeline.landmarks() if smoothed is None else list(smoothed.landmarks)
    landmarks.sort(key=lambda landmark: landmark.chainage_from)
    low, high = pipeline.span()
    found: Map = {
        "landmarks": [landmark_json(number, landmark) for number, landmark in enumerate(landmarks, 1)],
        "rings": pipeline.joints() if smoothed is None or not smoothed.joints else smoothed.joints,
        "focal_radius": pipeline.focal_radius(),
        "frames": pipeline.frames,
        "placed": pipeline.placed,
        "duration_s": round(duration_s, 2),
        "from_m": low,
        "to_m": high,
        "smoothed": smoothed is not None,
    }
    slips = () if smoothed is None else smoothed.slips
    if smoothed is not None:
        found |= smoothed.summary
    found["faults"] = sorted([*faults.untold(), *slips], key=lambda fault: float(fault["time_s"]))
    return found


def _thinned(frames: Iterable[VideoFrame], bar: Any) -> Iterator[VideoFrame]:
    due = -1e18
    for frame in frames:
        bar.update(1)
        if frame.time_s >= due:
            due = frame.time_s + OSD_EVERY_S
            yield frame


@contextmanager
def progress(label: str, count: int | None) -> Iterator[Any]:
    """A bar on stderr where somebody is looking."""
    with click.progressbar(length=count or 0, label=label, file=sys.stderr, hidden=not sys.stderr.isatty()) as bar:
        try:
            yield bar
        except KeyboardInterrupt:
            warn("Stopped: no map was made and nothing was kept.")
            raise click.Abort from None


def warn(sentence: str) -> None:
    """A sentence on stderr."""
    click.echo(f"borescout: {sentence}", err=True)
