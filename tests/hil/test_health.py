"""The whole device on a machine of fakes: what is wrong with the box is shown, told, and in the log of the survey."""

from __future__ import annotations

from pathlib import Path

from device.config import Settings
from device.daemon import HEALTH_TOPIC, Device
from device.health.machine import MachineReader
from device.health.watch import HotspotWatch
from device.recorder.reader import open_recording
from tests.hil.crawler_rig import Bench as CrawlerBench
from tests.unit.device.device_doubles import eventually
from tests.unit.device.machine_of_fakes import RADIO, FakeMachine


def test_a_silent_hotspot_is_noticed_and_started_anew(tmp_path: Path) -> None:
    """NetworkManager still calls it active; the radio says something else. The fake radio is cured by being started."""
    machine = FakeMachine(tmp_path)
    settings = Settings(data_dir=tmp_path / "data", machine=machine.settings)
    device = Device(settings, feeds=[])
    device._health._period_s = 0.05
    device._health._hotspot = HotspotWatch((0.2, 5.0))
    ear = device.subscribe()
    device.start()
    try:
        assert eventually(lambda: device.health()["machine"]["hotspot"] == "up")
        assert device.health()["machine"]["wifi_clients"] == 2
        machine.says("iw", RADIO.replace("type AP", "type managed"))
        assert eventually(lambda: [p["code"] for p in device.status()["prompts"]] == ["hotspot_silent"], 20)
        assert eventually(lambda: "nmcli connection up borescout" in machine.calls, 20)
        assert machine.calls.index("nmcli connection down borescout") < machine.calls.index("nmcli connection up borescout")
        machine.says("iw", RADIO)
        assert eventually(lambda: device.status()["prompts"] == [], 20)
        assert device.health()["hotspot_restored"] == 1
        codes = set()
        while (event := ear.get(0.1)) is not None:
            if event.name == "prompt":
                codes.add(event.data["code"])
        assert codes == {"hotspot_silent"}
    finally:
        device.close()


def test_the_log_of_a_survey_tells_how_the_box_was(tmp_path: Path) -> None:
    bench = CrawlerBench(tmp_path / "data", [])
    try:
        bench.up()
        number = bench.device.drive.begin()["survey_id"]
        bench.drive_to(bench.position + 0.5)
        bench.device.drive.end()
        bench.finished()
    finally:
        bench.close()
    [file] = (tmp_path / "data/recordings").glob(f"survey-{number:06d}-*.mcap")
    readings = [entry.sample for entry in open_recording(file).entries() if entry.topic == HEALTH_TOPIC]
    assert readings
    assert isinstance(readings[0], dict)
    assert readings[0]["disk_free_mb"] > 0
    assert [sensor["role"] for sensor in readings[0]["sensors"]] == ["grabber", "encoder"]


def test_restarts_of_the_hotspot_are_paced() -> None:
    watch = HotspotWatch((10.0, 60.0, 300.0))
    assert not watch.step(0.0, "up")
    begun = [t for t in range(1, 1000) if watch.step(float(t), "silent")]
    assert begun == [11, 71, 371, 671, 971]
    assert not watch.step(1000.0, "up")
    assert [t for t in range(1001, 1100) if watch.step(float(t), "off")] == [1011, 1071]
    assert not any(HotspotWatch().step(float(t), "unknown") for t in range(1000)), "a box without one starts none"


def test_to_start_anew_is_down_and_up(tmp_path: Path) -> None:
    machine = FakeMachine(tmp_path)
    reader = MachineReader(machine.settings)
    reader.restore_hotspot()
    assert [call.split()[2] for call in machine.calls] == ["down", "up"]
