"""A complete inspection out of the virtual sewer: measured, mapped and stored by what measures, maps and stores real ones."""

from __future__ import annotations

import numpy as np

from device.anomaly.scan import concluded
from device.anomaly.survey import reference_jpeg
from device.anomaly.work import Inspected, work
from device.diameter.clouds import cloud_json
from device.diameter.result import PipeContext, diameter_result
from device.inspections.demo_chamber import map_chamber
from device.json_text import plain
from device.landmarks.as_json import landmark_json
from device.pictures import encode_jpeg, frame_jpeg
from device.store import Kept, KeptLandmark, NewRecording, Store
from drivers.depth.base import DepthFrame
from drivers.virtual.campaign import VirtualRecording
from drivers.virtual.cctv import render
from drivers.virtual.detections import Detector, corrupted
from drivers.virtual.drive import Drive, Go
from drivers.virtual.furnish import furnished_sewer
from drivers.virtual.noise import StereoNoise, Window
from drivers.virtual.rig import HandMotion, Pose
from drivers.virtual.stereo_camera import StereoLens, StereoLook, StereoPainter, VirtualStereoCamera
from estimators.frame import estimate_frame
from estimators.landmarks.from_detections import Rig, Rows, map_detections
from estimators.landmarks.types import Landmark
from estimators.pinhole import Intrinsics
from estimators.stereo.rig import StereoRig

LENGTH_M, DIAMETER_M, DN = 25.0, 0.3, 300
END_M = 23.4
"""Where the crawler turns: a camera sees ahead of itself."""
FPS = 8.0
FRAMES = 20
STATION_M = 0.4
_BEFORE_M = 0.45
"""From where a deposit is scanned."""
_THUMBNAIL = 320
_AHEAD_M = 0.5
"""From where a landmark is photographed."""
_CORNER = (565000.0, 5933000.0)
_CRS = 25832
_DATE = "2026-06-01T09:00:00Z"
"""Of every demo inspection: the box that makes one need not know today's."""


def demo_inspection(store: Store, seed: int) -> int:
    """Put a site, a pipe, its surveys and one inspection into ``store``; the inspection's number. The same seed gives the same
    findings."""
    rng = np.random.default_rng([seed, 88])
    drive = Drive(furnished_sewer(rng, LENGTH_M, DIAMETER_M), (Go(END_M, 0.3),), seed=seed)
    if store.places.site()["crs"] is None:
        store.places.update_site({"crs": _CRS})
    pipe_id = _pipe(store, seed, rng)
    number = store.inspections.begin(
        pipe_id,
        {"operator": "borescout demo", "date": _DATE, "length_m": LENGTH_M, "note": f"virtual sewer, seed {seed}"},
    )
    store.inspections.add_survey(number, _measure(store, pipe_id, drive, seed), STATION_M)
    store.inspections.add_survey(number, _map(store, pipe_id, drive, seed))
    store.inspections.add_survey(number, _scan(store, pipe_id, drive, seed))
    store.inspections.add_survey(number, map_chamber(store, store.places.pipe(pipe_id)["start_node"], seed))
    return number


def _pipe(store: Store, seed: int, rng: np.random.Generator) -> int:
    taken = {node["name"] for node in store.places.nodes()}
    turn = 0
    while f"M{seed}-{turn}A" in taken:
        turn += 1
    heading = float(rng.uniform(0, 2 * np.pi))
    nodes = []
    for letter, along in (("A", 0.0), ("B", LENGTH_M)):
        east, north = _CORNER[0] + along * np.sin(heading), _CORNER[1] + along * np.cos(heading)
        nodes.append(
            store.places.create_node(
                f"M{seed}-{turn}{letter}", easting=round(east, 3), northing=round(north, 3), level=round(10 - 0.005 * along, 3)
            )["id"]
        )
    pipe = store.places.create_pipe(
        {
            "name": f"M{seed}-{turn}A-M{seed}-{turn}B",
            "start_node": nodes[0],
            "end_node": nodes[1],
            "material": "concrete",
            "reference_dn": DN,
            "length_m": LENGTH_M,
        }
    )
    return int(pipe["id"])


def _measure(store: Store, pipe_id: int, drive: Drive, seed: int) -> int:
    recording = VirtualRecording(
        id="demo",
        pipe_id="demo",
        dn=DN,
        truth_diameter_m=drive.sewer.profile.mean_diameter,
        position="entrance",
        troubles=(),
        sewer=drive.sewer,
        pose=Pose(0.01, -0.02, STATION_M, 0.03, -0.02, 0.0),
        motion=HandMotion(0.0015, 0.003, 25.0),
        noise=StereoNoise(),
        window=Window(),
        blur=0.0,
        seed=(seed, 88),
    )
    frames = list(recording.frames(FRAMES))
    estimates = [estimate_frame(depth, lens, unit, seed=k) for k, (depth, lens, unit) in enumerate(frames)]
    result = diameter_result(estimates, PipeContext("concrete", DN, "entrance"))
    depth, lens, unit = frames[-1]
    frame = DepthFrame(depth, lens, unit, 0, FRAMES, None)
    survey = store.surveys.begin("diameter", pipe_id)
    conclusion = {**result, "camera": "virtual stereo camera"}
    store.surveys.conclude(
        survey,
        "saved",
        [
            NewRecording(
                "virtual stereo camera",
                "entrance",
                FRAMES,
                conclusion,
                plain(cloud_json(frame, estimates[-1])),
                {"seed": seed},
                picture_depth=frame_jpeg("depth", frame),
            )
        ],
        conclusion,
    )
    return survey


def _map(store: Store, pipe_id: int, drive: Drive, seed: int) -> int:
    landmarks = map_detections(*_detections(drive, seed))
    survey = store.drives.begin(pipe_id, {"direction": "downstream", "radius_m": DIAMETER_M / 2, "seed": seed})
    kept = [
        KeptLandmark(number, landmark_json(number, landmark), _thumbnail(drive, landmark, seed))
        for number, landmark in enumerate(landmarks, 1)
    ]
    summary = {
        "from_m": 0.0,
        "to_m": END_M,
        "frames": round(drive.length_s * FPS),
        "seconds": round(drive.length_s, 1),
        "smoothed": True,
    }
    store.drives.keep(survey, Kept(landmarks=kept, summary=summary), state="saved")
    return survey


def _scan(store: Store, pipe_id: int, drive: Drive, seed: int) -> int:
    """A stereo pair before the first deposit, or at the pipe's beginning where there is none."""
    deposits = [one.chainage for one in drive.truth.landmarks if one.label == "deposit" and one.chainage > 1.5]
    chainage = round(min(deposits, default=_BEFORE_M + STATION_M) - _BEFORE_M, 2)
    painter = StereoPainter(drive.sewer, StereoLens(Intrinsics(640, 400, 373.0, 373.0, 319.5, 199.5)), StereoLook(), seed)
    left, right = painter.pair(Pose(0.005, -0.01, chainage, 0.01, -0.01), np.random.default_rng([seed, 91]))
    inspected = work(True, left, right, StereoRig(painter.lens.intrinsics, painter.lens.baseline_m))
    assert isinstance(inspected, Inspected)
    camera = VirtualStereoCamera.name
    result, chosen = concluded([inspected.result], camera, chainage)
    survey = store.surveys.begin("anomaly", pipe_id)
    views = inspected.views if chosen is not None else None
    recording = NewRecording(
        camera,
        None,
        1,
        result,
        None if views is None else plain(views.cloud),
        {"seed": seed},
        picture_color=reference_jpeg(left) if views is None else views.reference,
        overlay=None if views is None else views.overlay,
        map=None if views is None else views.map,
    )
    store.surveys.conclude(survey, "saved", [recording], result)
    return survey


def _detections(drive: Drive, seed: int) -> tuple[Rows, Rig]:
    """What a good detector sees on the way, with the focus of expansion as the flow would find it."""
    rng = np.random.default_rng([seed, 89])
    detector = Detector(dict.fromkeys(_classes(drive), (0.97, 0.9)), noise_px=6.0, fps=FPS, seed=seed)
    rows: list[tuple[int, float, float, float, float, str, float, float, float]] = []
    for frame in range(int(drive.length_s * FPS)):
        t = frame / FPS
        centre = drive.truth.focus_of_expansion(t)
        where = (frame, t, float(drive.position(t)))
        seen = corrupted(drive, t, rng, detector)
        rows += [(*where, one.u, one.v, one.label, 0.9, *centre) for one in seen]
        if not seen:
            rows.append((*where, np.nan, np.nan, "", 0.0, *centre))
    frames, times, chainage, u, v, label, score, foe_u, foe_v = zip(*rows, strict=True)
    camera = drive.camera
    return Rows(
        np.array(frames, np.int64),
        np.array(times),
        np.array(chainage),
        np.array(u),
        np.array(v),
        list(label),
        np.array(score),
        np.column_stack([foe_u, foe_v]),
    ), Rig(camera.fx, camera.fy, camera.cx, camera.cy, DIAMETER_M / 2, camera.width, camera.height)


def _classes(drive: Drive) -> set[str]:
    return {landmark.label for landmark in drive.truth.landmarks}


def _thumbnail(drive: Drive, landmark: Landmark, seed: int) -> bytes:
    """The picture from a step before it."""
    pose = Pose(chainage=max(landmark.chainage_from - _AHEAD_M, 0.0))
    picture = render(drive.sewer, drive.camera, pose, np.random.default_rng([seed, 90]), drive.look)
    step = max(1, round(picture.shape[1] / _THUMBNAIL))
    return encode_jpeg(np.ascontiguousarray(picture[::step, ::step]))
