"""A real chain: depth frames of one pipe, the stills of a crawler run and a stereo pair become one inspection and one report.

BORESCOUT_DATA=... python -m tests.bench.real_chain [--out FOLDER]

Each survey is made by the box as a field box makes it, with recordings in place of its sensors, at their own pace: it takes
some minutes. The three are of different pipes, for nobody has recorded all of one; what is shown is that real input goes the
whole way. Lengths of the run are in the unit of its counter, which the recording does not state.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pypdf import PdfReader

from device.clock import Clock
from device.config import CrawlerSettings, Settings, StereoSettings
from device.daemon import Device
from tests.bench.real_data import fail
from tests.bench.table import print_table

PIPE = "400mm_PVC"
FIRST_S, FIRST_DISTANCE, LAST_DISTANCE = 129.0, 7.0, 50.0
"""Where the run goes straight on with its counter set."""
PAIR = ("D_series_D3", "Front")
DAY = "2026-06-01T09:00:00Z"
LIMIT_S = 300.0


def main() -> None:
    """Print what became of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, help="keep report, ZIP and recordings here")
    chosen = parser.parse_args()
    root = os.environ.get("BORESCOUT_DATA")
    if not root or not Path(root).is_dir():
        fail("Set BORESCOUT_DATA to the folder of the shared recordings.")
    with tempfile.TemporaryDirectory(prefix="borescout-chain-") as temporary:
        folder = chosen.out or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        chain(Path(str(root)), folder, Path(temporary))


def chain(root: Path, folder: Path, temporary: Path) -> None:
    """All of it, on the box whose data lies in ``folder``."""
    recorded = depth_frames(root / "realsense_pipes", temporary / "depth")
    with box(folder, cameras=("replay",), replay=recorded) as device:
        pipe = _pipe(device)
        wait(lambda: device.status()["cameras"][0]["state"] == "up")
        measured = device.measure(pipe, "entrance")["survey_id"]
        wait(lambda: device.status()["survey"]["state"] == "idle")
        device.measure(pipe, "middle", survey_id=measured)  # a pipe this wide is measured twice
        wait(lambda: device.status()["survey"]["state"] == "idle")
    crawler = CrawlerSettings(grabber="stills", grabber_source=str(stills(root / "cctv_run", temporary / "run")), encoder="osd")
    with box(folder, crawler=crawler) as device:
        device.drive.begin(pipe)
        wait(lambda: (device.drive.state()["chainage_m"] or 0.0) >= LAST_DISTANCE or not device.drive.state()["available"])
        driven = device.drive.end(None)["survey_id"]
        wait(lambda: device.drive.state()["state"] == "idle")
    with box(folder, stereo=StereoSettings(driver="replay", source=pair(root / "stereo_pipes", temporary / "pair"))) as device:
        wait(lambda: (device.anomaly.look()["camera"] or {}).get("state") == "up")
        scanned = device.anomaly.scan(pipe, 12.0)["survey_id"]
        wait(lambda: device.anomaly.state()["state"] == "idle")
        number = device.inspections.begin(pipe, {"operator": "real chain", "date": DAY, "length_m": 60.0})["id"]
        device.inspections.join(number, measured, 0.0)
        began = time.perf_counter()
        report, name, _ = device.inspections.export(number, "pdf", "en", False)
        report_s = time.perf_counter() - began
        (folder / name).write_bytes(report)
        packed, zip_name, _ = device.inspections.export(number, "zip", "en", False)
        (folder / zip_name).write_bytes(packed)
        tell(device, number, {"depth": measured, "drive": driven, "stereo": scanned})
    pages = PdfReader(folder / name).pages
    print(f"report: {len(pages)} pages, {sum(len(page.images) for page in pages)} pictures, {report_s:.2f} s")
    print(f"ZIP: {len(packed) / 1e6:.1f} MB; kept in {folder}")


@contextmanager
def box(folder: Path, **sensors: Any) -> Iterator[Device]:
    """The box with these sensors, for as long as the block lasts."""
    feeds = None if "cameras" in sensors else []
    device = Device(Settings(data_dir=folder / "data", **sensors), feeds=feeds, clock=Clock(folder / "no-clock")).start()
    try:
        yield device
    finally:
        device.close()


def depth_frames(source: Path, folder: Path) -> Path:
    """The frames of one pipe with the emitter on, as a recording of their own."""
    entries = [
        entry for entry in json.loads((source / "manifest.json").read_text()) if entry["pipe"] == PIPE and entry["emitter"]
    ]
    folder.mkdir(parents=True)
    (folder / PIPE).symlink_to(source / PIPE)
    (folder / "manifest.json").write_text(json.dumps(entries))
    return folder


def stills(source: Path, folder: Path) -> Path:
    """The straight part of the run."""
    folder.mkdir(parents=True)
    for picture in source.glob("*.jpg"):
        if float(picture.stem) >= 1000 * FIRST_S:
            (folder / picture.name).symlink_to(picture)
    return folder


def pair(source: Path, folder: Path) -> Path:
    """One stereo pair, as a recording of its own."""
    told = json.loads((source / "manifest.json").read_text())
    told["pairs"] = [one for one in told["pairs"] if one["left"].startswith("_".join(PAIR))]
    folder.mkdir(parents=True)
    for one in told["pairs"]:
        for side in ("left", "right"):
            (folder / one[side]).symlink_to(source / one[side])
    (folder / "manifest.json").write_text(json.dumps(told))
    return folder


def wait(condition: Callable[[], Any]) -> None:
    """Until it is so."""
    deadline = time.monotonic() + LIMIT_S
    while not condition():
        if time.monotonic() > deadline:
            fail(f"The box did not get on within {LIMIT_S:.0f} s.")
        time.sleep(0.1)


def _pipe(device: Device) -> int:
    nodes = [device.places.create_node(name)["id"] for name in ("A", "B")]
    data = {"name": "A-B", "start_node": nodes[0], "end_node": nodes[1], "material": "PVC", "reference_dn": 400}
    return int(device.places.create_pipe(data)["id"])


def tell(device: Device, number: int, surveys: dict[str, int]) -> None:
    """What each survey came to, and the inspection."""
    rows = []
    for source, survey_id in surveys.items():
        survey = device.survey(survey_id)
        rows.append((source, survey_id, survey["kind"], survey["state"]))
    print_table("Surveys", ("from", "number", "kind", "state"), rows)
    inspection = device.inspections.get(number)
    rows = [(one["station"], one["code"], one["remark"]) for one in inspection["observations"]]
    print_table(f"Inspection {number}: {len(inspection['photos'])} photos", ("station", "code", "remark"), rows)


if __name__ == "__main__":
    main()
