from pathlib import Path

import pytest

from device.config import Settings, load_settings
from device.errors import Invalid


def test_everything_has_a_default(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    settings = load_settings()
    assert settings.frames == 50
    assert settings.data_dir == tmp_path / "borescout"
    assert settings.host == "127.0.0.1"  # nobody is served who was not meant to be


def test_what_is_given_outranks_the_file(tmp_path: Path) -> None:
    file = tmp_path / "box.toml"
    file.write_text('frames = 30\nport = 9000\ncameras = ["oak", "realsense"]\n')
    settings = load_settings(file, port=9001, host=None)
    assert (settings.frames, settings.port, settings.cameras) == (30, 9001, ("oak", "realsense"))


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("frames = 0", "The setting frames cannot be 0: input should be greater than or equal to 1."),
        ('port = "x"', "The setting port cannot be 'x'"),
        ("framse = 20", "There is no setting called framse."),
        ('cameras = ["kinect"]', "The setting cameras.0 cannot be 'kinect'"),
        ("frames = ", "is not valid TOML"),
        ("frames = 3\nframes = 4", "is not valid TOML"),
    ],
)
def test_a_bad_file_is_told_in_one_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    file = tmp_path / "box.toml"
    file.write_text(text)
    with pytest.raises(Invalid) as told:
        load_settings(file)
    assert sentence in str(told.value)
    assert "\n" not in str(told.value)


def test_a_missing_or_binary_file_is_told_in_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(Invalid, match="There is no settings file"):
        load_settings(tmp_path / "nowhere.toml")
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(Invalid, match="cannot be read"):
        load_settings(tmp_path / "b.toml")


def test_settings_cannot_be_changed_afterwards() -> None:
    with pytest.raises(ValueError, match="frozen"):
        Settings().frames = 3  # type: ignore[misc] # the point of the test
