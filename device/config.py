"""Settings: defaults, then an optional TOML file, then the command line."""

from __future__ import annotations

import os
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator, model_validator

from device.autonomy.machine import Rules
from device.errors import Invalid
from device.landmarks.detectors import EVERY

CameraKind = Literal["realsense", "oak", "replay", "virtual"]


def default_data_dir() -> Path:
    """Where findings are kept unless the operator says otherwise."""
    base = os.environ.get("XDG_DATA_HOME")
    return (Path(base) if base else Path.home() / ".local" / "share") / "borescout"


GrabberKind = Literal["none", "v4l2", "stream", "video", "stills", "stereo", "virtual"]
EncoderKind = Literal["none", "qsb", "lci90", "modbus", "nmea", "pattern", "csv", "osd", "virtual"]


class CrawlerSettings(BaseModel):
    """The crawler: where its pictures come from, what counts its tether, and how its camera looks. The table ``[crawler]``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    grabber: GrabberKind = "none"
    grabber_source: str = ""
    """Device (/dev/video0), address of a stream, video file or folder of stills; "stereo" is the left picture of [stereo]."""
    grabber_options: dict[str, str | int | float] = {}
    """Further arguments of the driver, by name."""
    encoder: EncoderKind = "none"
    encoder_port: str = ""
    """Serial port, or the CSV file."""
    encoder_options: dict[str, str | int | float] = {}
    """Further arguments of the driver, by name: baud, pattern, unit ..."""
    counts_per_metre: float = Field(1.0, gt=0)
    """Until it is set or calibrated on the page; 1 for a counter that shows metres."""
    osd_region: tuple[int, int, int, int] | None = None
    """Left, top, width and height (px) of the burned-in distance; found by itself where it is not given."""
    detect_every: int = Field(EVERY, ge=1, le=100)
    """The network looks at each so manieth picture; the survey predicts in between."""
    radius_m: float | None = Field(None, gt=0, le=5)
    """Interior radius, for a pipe whose DN is not known."""
    focal_px: tuple[float, float] | None = None
    """fx and fy of the camera; without them only what rings tell is known of f * R."""
    centre_px: tuple[float, float] | None = None
    """Principal point; the middle of the picture where it is not given."""


class MachineSettings(BaseModel):
    """The computer underneath, as health asks it: a folder of fakes can stand in for it. The table ``[machine]``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    root: Path = Path("/")
    """Holds the ``proc``, ``sys`` and ``run`` to look into."""
    vcgencmd: str = "vcgencmd"
    """The helper programs, by name or path."""
    iw: str = "iw"
    nmcli: str = "nmcli"
    wifi: str = "wlan0"
    """The interface of the hotspot."""
    hotspot: str = ""
    """NetworkManager's name of the hotspot, to be watched and restored; empty where this box has none."""


ScannerKind = Literal["none", "camera", "virtual"]


class StructureSettings(BaseModel):
    """What maps a chamber: a scanner and the navigation of what carries it. The table ``[structure]``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    scanner: ScannerKind = "none"
    """"camera": scans are pictures of the box's first depth camera; "virtual": a chamber with all of its sensors."""
    scan_hz: float = Field(0.5, gt=0, le=5)
    """Scans a second taken from the depth camera."""
    dvl: Literal["none", "waterlinked"] = "none"
    dvl_port: str = ""
    pressure: Literal["none", "nmea"] = "none"
    pressure_port: str = ""
    ahrs: Literal["none", "vectornav", "xsens"] = "none"
    ahrs_port: str = ""
    options: dict[str, dict[str, int | float]] = {}
    """Further arguments of the drivers, by "dvl", "pressure" and "ahrs": baud, density ..."""
    tilt_deg: float = Field(0.0, ge=-90, le=90)
    """How far the scanner looks down."""
    offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Of the scanner from the vehicle's centre: forward, right, down."""
    pipe_radius_m: float = Field(0.0315, ge=0.01, le=0.064)
    """Outer radius of the pipes."""
    upright: bool = False
    """Pipes are horizontal or vertical: what is neither is left out."""
    file: Path | None = None
    """With the virtual scanner: a structure file; the paper's structure where it is not given."""


LampKind = Literal["none", "gpiozero", "virtual"]


class LampSettings(BaseModel):
    """The lamp of the box. The table ``[lamp]``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    driver: LampKind = "none"
    options: dict[str, int | float] = {}
    """Further arguments of the driver, by name: pin, hz."""


StereoKind = Literal["none", "realsense", "oak", "pair", "replay", "virtual"]
LIVE_STEREO = ("realsense", "oak", "pair")


class StereoSettings(BaseModel):
    """The stereo camera of the anomaly survey. The table ``[stereo]``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    driver: StereoKind = "none"
    source: Path | None = None
    """Folder of recorded pairs, for the driver "replay"."""
    left: str = ""
    """V4L2 devices of two plain cameras, as seen from behind them, for the driver "pair"."""
    right: str = ""
    options: dict[str, str | int | float] = {}
    """Further arguments of a live driver, by name: serial, width, height, fps, laser_power, exposure_us; fps and codec of
    "pair"."""
    calibration: Path | None = None
    """A file of ``borescout calibrate stereo``; "pair" needs one of a board."""
    pairs: int = Field(3, ge=1, le=20)
    """Pairs of one scan: what shows in one of them alone is not told as a finding."""
    rate_hz: float = Field(2.0, gt=0, le=30)
    """Pairs a second of a recording and of the virtual camera."""
    hold_s: float = Field(30.0, gt=0)
    """How long each pair of a recording stays, and the virtual camera at each place."""


class AutonomySettings(BaseModel):
    """Logging by itself. The table ``[autonomy]``; the last word on the page counts more than ``enabled``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    enabled: bool = False
    rules: dict[str, Annotated[float, Field(gt=0)]] = {}
    """Fields of ``device.autonomy.machine.Rules`` by name, in seconds and metres."""

    @field_validator("rules")
    @classmethod
    def _known(cls, rules: dict[str, float]) -> dict[str, float]:
        known = [field.name for field in fields(Rules)]
        for name in rules:
            if name not in known:
                raise ValueError(f"there is no rule called {name}, known are {', '.join(known)}")
        return rules

    def made(self) -> Rules:
        """The rules, the others as they are."""
        return Rules(**self.rules)  # type: ignore[arg-type]  # a number of tries comes as a float, and serves as one


class RecordingSettings(BaseModel):
    """Raw data of every survey. The table ``[recording]``."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    enabled: bool = True
    keep_free_mb: int = Field(1000, ge=0)
    """Below this much free space the oldest recordings are removed."""
    stop_free_mb: int = Field(300, ge=0)
    """Below this, with none left to remove, recording ends: the rest is for findings."""
    most_mb: int | None = Field(None, gt=0)
    """All recordings together; as much as fits where it is not given."""
    part_mb: int = Field(128, ge=1)
    """A long recording is split into files of this size."""

    @model_validator(mode="after")
    def _in_order(self) -> RecordingSettings:
        if self.stop_free_mb > self.keep_free_mb:
            raise ValueError("keep_free_mb must not be less than stop_free_mb")
        return self


class Settings(BaseModel):
    """Everything that can be set. All have defaults; names the program does not know are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    data_dir: Path = Field(default_factory=default_data_dir)
    host: str = Field("127.0.0.1", min_length=1)
    port: int = Field(8080, ge=0, le=65535)
    """0 for any that is free."""
    pin: str | None = Field(None, pattern=r"^[0-9]{6}$")
    """To pair with; otherwise the one on the label, which the first start draws and keeps in the data folder."""
    allowed_hosts: tuple[str, ...] = ()
    """Names by which browsers may call the box, besides its own host name and addresses."""
    cameras: tuple[CameraKind, ...] = Field(("realsense",), max_length=2)
    """Depth cameras; none for a box whose only camera is the stereo camera."""
    replay: Path | None = None
    """Folder with a manifest, or a .db3 or .bag file, for the camera "replay"."""
    replay_hz: float = Field(30.0, gt=0, le=120)
    replay_hold_s: float = Field(6.0, gt=0)
    """How long each picture of a folder stays before the camera, so that it can be looked at and measured."""
    frames: int = Field(50, ge=1, le=500)
    """Frames of one recording."""
    live_hz: float = Field(4.0, ge=2.0, le=15.0)
    """Estimates a second while the operator aims."""
    workers: int = Field(2, ge=1, le=8)
    reserve_mb: int = Field(50, ge=1)
    """Free disk space below which no measurement is started."""
    purge_days: int = Field(30, ge=1)
    """How long a deleted survey can be brought back."""
    virtual_cameras: int = Field(1, ge=1, le=2)
    """With ``virtual``: 1 for active stereo, 2 for a time-of-flight camera beside it."""
    virtual_seed: int = Field(1, ge=0)
    """Which pipe the virtual sewer draws."""
    crawler: CrawlerSettings = Field(default_factory=lambda: CrawlerSettings.model_validate({}))
    autonomy: AutonomySettings = Field(default_factory=lambda: AutonomySettings.model_validate({}))
    recording: RecordingSettings = Field(default_factory=lambda: RecordingSettings.model_validate({}))
    structure: StructureSettings = Field(default_factory=lambda: StructureSettings.model_validate({}))
    lamp: LampSettings = Field(default_factory=lambda: LampSettings.model_validate({}))
    stereo: StereoSettings = Field(default_factory=lambda: StereoSettings.model_validate({}))
    machine: MachineSettings = Field(default_factory=lambda: MachineSettings.model_validate({}))
    virtual_description: Path | None = None
    """JSON file that describes the virtual sewer instead, with its faults."""

    @field_validator("stereo")
    @classmethod
    def _one_owner(cls, stereo: StereoSettings, about: ValidationInfo) -> StereoSettings:
        live = stereo.driver in ("realsense", "oak") and stereo.driver in about.data.get("cameras", ())
        if live and "serial" not in stereo.options:
            raise ValueError(
                f"one {stereo.driver} camera cannot give depth and stereo pairs at once, "
                "take it out of cameras or name the serial number of another in the options of [stereo]"
            )
        return stereo


def load_settings(file: Path | None = None, **given: Any) -> Settings:
    """Settings from ``file`` (TOML) with ``given`` on top, where None counts as not given. Raises Invalid, in one sentence."""
    values: dict[str, Any] = {}
    if file is not None:
        try:
            values = tomllib.loads(file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise Invalid(f"There is no settings file {file}.") from None
        except (OSError, UnicodeDecodeError) as error:
            raise Invalid(f"The settings file {file} cannot be read: {error}.") from None
        except tomllib.TOMLDecodeError as error:
            raise Invalid(f"The settings file {file} is not valid TOML: {error}.") from None
    for name, value in given.items():
        if isinstance(value, dict) and isinstance(values.get(name), dict):
            values[name] = {**values[name], **value}  # single settings of a table
        elif value is not None:
            values[name] = value
    try:
        return Settings(**values)
    except ValidationError as error:
        raise Invalid(sentence(error, "setting")) from None


def sentence(error: ValidationError, what: str) -> str:
    """The first thing pydantic found wrong, as one sentence."""
    first = error.errors(include_url=False, include_input=True)[0]
    name = ".".join(str(part) for part in first["loc"]) or what
    if first["type"] == "extra_forbidden":
        return f"There is no {what} called {name}."
    if first["type"] == "missing":
        return f"The {what} {name} is missing."
    message = first["msg"].removeprefix("Value error, ").rstrip(".")
    return f"The {what} {name} cannot be {first['input']!r}: {message[:1].lower()}{message[1:]}."
