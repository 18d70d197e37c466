"""Two lenses found again from views of a board, and every way in which views are not enough."""

from __future__ import annotations

import json
import re
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from click.testing import CliRunner
from PIL import Image

from device.anomaly.calibration import (
    BoardCalibration,
    KnownPipeCalibration,
    board_calibration,
    load_calibration,
    save_calibration,
)
from device.calibrating import board_views
from device.calibrating.board_paper import write_board
from device.calibrating.board_views import Found, Kept, from_cameras, from_folder, pairs_of
from device.calibrating.command import _by_board
from device.calibrating.known_pipe import by_known_pipe
from device.cli import cli
from device.errors import Invalid
from drivers.base import FrameTimeout, SensorLost, SensorMissing
from drivers.grabber.base import VideoFrame
from drivers.stereo.replay import pair_folder
from estimators.board.board import Board, Sighting, as_seen_by_both, edge_blur
from estimators.board.calibration import NotEnough, View, calibrate_pair, disparity_errors
from estimators.board.coverage import coverage
from estimators.board.gathering import Gathering
from estimators.pinhole import LensPair, rectified
from tests.unit.device.board_views import SIZE, Photographer, Place, good_places, lenses

BOARD = Board()


def seen(count: int = 24, seed: int = 0, off_px: float = 0.08, **given: Any) -> list[View]:
    rng = np.random.default_rng(seed)
    camera = Photographer(BOARD, **given)
    return [camera.view(f"{number:02d}", place, rng, off_px) for number, place in enumerate(good_places(rng, count))]


def errors(found: LensPair) -> tuple[float, float]:
    """What disparities are off by (px, rms over the picture and three depths), and the baseline as a share of it."""
    off = disparity_errors(found, lenses())[0]
    return float(np.sqrt(np.nanmean(off**2))), rectified(found).baseline_m / rectified(lenses()).baseline_m - 1


@pytest.mark.parametrize("seed", range(2))
def test_two_lenses_are_found_again_and_the_doubt_is_of_the_size_of_the_error(seed: int) -> None:
    result = calibrate_pair(BOARD, seen(seed=seed), SIZE)
    truth = lenses()
    for found, true in ((result.lenses.left, truth.left), (result.lenses.right, truth.right)):
        assert found.fx == pytest.approx(true.fx, rel=0.002)
        assert found.fy == pytest.approx(true.fy, rel=0.002)
        assert (found.ppx, found.ppy) == pytest.approx((true.ppx, true.ppy), abs=0.8)
    assert np.allclose(result.lenses.rotation, truth.rotation, atol=0.002)
    off_px, scale = errors(result.lenses)
    assert off_px < 0.15
    assert abs(scale) < 0.003
    assert off_px < 3 * result.offset_std_px
    assert abs(scale) < 3 * result.scale_std
    assert result.offset_std_px < 0.1
    assert result.reprojection_px == pytest.approx(0.08, rel=0.25), "the noise that was put into the corners"
    assert result.epipolar_px < 0.12
    assert result.left_out == ()


def test_more_noise_is_more_doubt() -> None:
    assert calibrate_pair(BOARD, seen(off_px=0.3), SIZE).offset_std_px > 2 * calibrate_pair(BOARD, seen(), SIZE).offset_std_px


@pytest.mark.parametrize(
    ("views", "says"),
    [
        (seen(8), "There are 8 usable views of the board, at least 12"),
        (seen(blur=2.5), "0 usable views.*Blurred are 00, 01.*hold the board still"),
        (seen(off_px=1.5), "lie .* px off|differ by|come out differently"),
    ],
    ids=["few", "blurred", "noisy"],
)
def test_views_that_are_not_enough_are_refused_with_the_reason(views: list[View], says: str) -> None:
    with pytest.raises(NotEnough, match=says) as caught:
        calibrate_pair(BOARD, views, SIZE)
    assert "?" in str(caught.value) or str(caught.value).endswith(".")


def test_a_view_of_one_row_of_corners_tells_nothing_and_is_left_out() -> None:
    views = seen(20)
    row = np.arange(BOARD.columns - 1)
    one_row = replace(
        views[0],
        left=replace(views[0].left, ids=row, pixels=views[0].left.pixels[: len(row)]),
        right=replace(views[0].right, ids=row, pixels=views[0].right.pixels[: len(row)]),
    )
    assert not one_row.shows_enough(BOARD)
    assert calibrate_pair(BOARD, [*views, replace(one_row, name="row")], SIZE).views == calibrate_pair(BOARD, views, SIZE).views
    assert Gathering(BOARD, SIZE).take("row", one_row.left, one_row.right) == "too little of the board is in both pictures"


def shown(places: list[Place]) -> list[View]:
    rng = np.random.default_rng(0)
    return [Photographer(BOARD).view(f"{number:02d}", place, rng) for number, place in enumerate(places)]


def test_views_on_one_side_of_the_picture_are_refused_and_say_where_to_go() -> None:
    places = [
        replace(place, middle=(-abs(place.middle[0]) - 0.03, *place.middle[1:]))
        for place in good_places(np.random.default_rng(0), 24)
    ]
    with pytest.raises(
        NotEnough, match=r"cover .* % of the two pictures, 75 % are needed: show the board in the .*right"
    ) as caught:
        calibrate_pair(BOARD, shown(places), SIZE)
    assert "right of the left picture" in str(caught.value)


def test_a_board_that_always_faces_the_camera_is_refused() -> None:
    places = [replace(place, turned=(0.0, 0.0, place.turned[2])) for place in good_places(np.random.default_rng(0), 24)]
    with pytest.raises(NotEnough, match="hardly tilted: show it also with its left edge nearer and with its right edge nearer"):
        calibrate_pair(BOARD, shown(places), SIZE)


@pytest.mark.parametrize(
    ("turned", "tilt"),
    [((0.0, 0.4, 0.0), 0), ((0.0, -0.4, 0.0), 1), ((-0.4, 0.0, 0.0), 2), ((0.4, 0.0, 0.0), 3), ((0.0, 0.0, 0.3), None)],
)
def test_tilts_are_told_by_the_edge_that_is_nearer(turned: tuple[float, float, float], tilt: int | None) -> None:
    """Turned by +0.4 about the axis downwards the board's right edge goes away from the camera, so its left one is nearer."""
    (view,) = shown([Place((0.0, 0.0, 0.4), turned)])
    tilts = coverage(BOARD, [(view.left, view.right)], SIZE).tilts
    assert tilts == tuple(int(index == tilt) for index in range(4))


def moved(view: View, down: float) -> View:
    return replace(view, right=replace(view.right, pixels=view.right.pixels + np.array([0.0, down])))


def test_views_that_disagree_are_left_out_by_name() -> None:
    views = seen()
    views[5], views[11] = moved(views[5], 4.0), moved(views[11], -3.0)
    result = calibrate_pair(BOARD, views, SIZE)
    assert [name for name, _ in result.left_out] == ["05", "11"]
    assert all(off > 1.0 for _, off in result.left_out)
    assert errors(result.lenses)[0] < 0.15
    assert "05" not in result.views


def test_too_many_that_disagree_are_named_and_nothing_is_made_of_them() -> None:
    rng = np.random.default_rng(1)
    views = [moved(view, float(rng.normal(0, 6))) if index % 3 == 0 else view for index, view in enumerate(seen())]
    with pytest.raises(NotEnough, match=r"disagree with the others: .*\(\d+\.\d px\)|lie .* off|rows .* differ"):
        calibrate_pair(BOARD, views, SIZE)


def test_left_and_right_exchanged_are_noticed() -> None:
    with pytest.raises(NotEnough, match="were left and right exchanged"):
        calibrate_pair(BOARD, [replace(view, left=view.right, right=view.left) for view in seen()], SIZE)


# --- the board in pictures ---


@pytest.mark.parametrize("kind", ["charuco", "chessboard"])
def test_a_printed_board_is_found_with_all_its_corners(tmp_path: Path, kind: str) -> None:
    board = Board(kind, 7, 5, 0.01)
    write_board(board, tmp_path / "board.png", "A4")
    with Image.open(tmp_path / "board.png") as printed:
        dots = printed.info["dpi"][0]
        paper = np.asarray(printed)
    square = dots / 25.4 * 10.0
    assert paper.shape[1] == pytest.approx(8 * square, abs=2), "seven squares and a half on either side"
    small = cv2.resize(paper, None, fx=40 / square, fy=40 / square, interpolation=cv2.INTER_AREA)
    found = board.find(np.asarray(cv2.GaussianBlur(small, (0, 0), 0.8), dtype=np.uint8))
    assert found is not None
    assert sorted(found.ids) == list(range(board.corners))
    places = board.points[found.ids][:, :2] / 0.01 * 40 + 20 - 0.5
    turned = np.array([small.shape[1] - 1, small.shape[0] - 1]) - places  # a chessboard may be counted from its other end
    off = min(float(np.abs(found.pixels - way).max()) for way in (places, turned if kind == "chessboard" else places))
    assert off < 0.35


def test_a_pdf_is_to_scale_and_a_board_too_large_is_refused(tmp_path: Path) -> None:
    write_board(BOARD, tmp_path / "board.pdf", "A4")
    raw = (tmp_path / "board.pdf").read_bytes()
    assert b"/MediaBox [ 0 0 841.8898 595.2756 ]" in raw
    # drawn by a matrix whose scale is the size in points, 72 of which are an inch
    text = b"".join(_streams(raw)).decode("latin-1")
    wide, high = (float(number) for number in re.search(r"([\d.]+) 0 0 ([\d.]+) [\d.]+ [\d.]+ cm\s*/\w+", text).groups())  # type: ignore[union-attr]
    assert (wide / 72 * 25.4, high / 72 * 25.4) == pytest.approx((270.0, 180.0), abs=0.05)
    with pytest.raises(Invalid, match="360 x 270 mm does not fit on A4"):
        write_board(Board(columns=12, rows=9), tmp_path / "large.pdf", "A4")
    write_board(Board(columns=12, rows=9), tmp_path / "large.pdf", "A3")
    with pytest.raises(Invalid, match=r"\.pdf or \.png"):
        write_board(BOARD, tmp_path / "board.svg", "A4")


def _streams(raw: bytes) -> list[bytes]:
    import base64

    found = []
    for part in re.findall(rb"stream\r?\n(.*?)endstream", raw, re.DOTALL):
        try:
            found.append(zlib.decompress(base64.a85decode(part.strip().removesuffix(b"~>"))))
        except (ValueError, zlib.error):
            continue
    return found


@pytest.mark.parametrize("blur", [0.8, 1.5, 3.0])
def test_the_blur_of_edges_is_measured(blur: float) -> None:
    picture = np.kron(np.indices((6, 6)).sum(axis=0) % 2, np.ones((40, 40))) * 150 + 40
    soft = cv2.GaussianBlur(picture, (0, 0), blur)
    corners = np.stack(np.meshgrid(np.arange(1, 6) * 40 - 0.5, np.arange(1, 6) * 40 - 0.5), axis=-1).reshape(-1, 2)
    # a Sobel kernel of three adds some blur of its own
    assert edge_blur(np.asarray(np.round(soft), np.uint8), corners, 14) == pytest.approx(np.hypot(blur, 0.6), rel=0.15)


def test_a_chessboard_that_one_camera_counts_from_its_other_end_is_turned() -> None:
    (view,) = shown([Place((0.0, 0.0, 0.4))])
    upside_down = replace(view.right, pixels=view.right.pixels[::-1].copy())
    assert np.array_equal(as_seen_by_both(view.left, upside_down).pixels, view.right.pixels)
    assert as_seen_by_both(view.left, view.right) is view.right


@pytest.mark.parametrize("wrong", [{"kind": "dots"}, {"columns": 3}, {"rows": 99}, {"square_m": 0.0}])
def test_boards_that_cannot_be_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"board|squares"):
        Board(**wrong)


# --- from pictures to a file ---


def test_pictures_of_a_board_become_a_calibration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Rendered ray by ray through known lenses, found, calibrated, written, read."""
    rng = np.random.default_rng(5)
    camera = Photographer(BOARD)
    for number, place in enumerate(good_places(rng, 15)):
        for side, picture in zip("LR", camera.pictures(place, rng), strict=True):
            cv2.imwrite(str(tmp_path / f"{number:02d}_{side}.png"), picture)
    cv2.imwrite(str(tmp_path / "98_L.png"), np.full(SIZE[::-1], 90, np.uint8))
    cv2.imwrite(str(tmp_path / "98_R.png"), np.full(SIZE[::-1], 90, np.uint8))
    found = from_folder(BOARD, tmp_path)
    assert "98_L.png: no board in the left and right picture" in capsys.readouterr().err
    out = tmp_path / "rig.json"
    _by_board(BOARD, found, out)
    told = capsys.readouterr().out
    assert "written to" in told
    kept = load_calibration(out)
    assert isinstance(kept, BoardCalibration)
    off_px, scale = errors(kept.lenses())
    assert off_px < 0.3
    assert abs(scale) < 0.005
    assert off_px < 4 * kept.offset_std_px
    # what is better takes its place; what is worse, or nothing, does not
    _by_board(BOARD, Found(seen(), SIZE), out)
    before = out.read_bytes()
    assert load_calibration(out) != kept
    with pytest.raises(Invalid, match="at least 12 are needed"):
        _by_board(BOARD, Found(found.views[:5], found.size), out)
    with pytest.raises(Invalid, match="is better"):
        _by_board(BOARD, Found(seen(off_px=0.45), SIZE), out)
    with pytest.raises(Invalid, match="calibration of two lenses: choose another"):
        by_known_pipe(tmp_path, 0.5, out)
    assert out.read_bytes() == before


def test_the_calibration_by_a_pipe_is_not_overwritten_by_a_board(tmp_path: Path) -> None:
    out = tmp_path / "pipe.json"
    pipe = KnownPipeCalibration(
        width=1920, offset_px=31.0, offset_std_px=0.4, scale=1.0, scale_std=0.003, shift_px=40.0, diameter_m=0.5, pairs=["a"]
    )
    save_calibration(out, pipe)
    with pytest.raises(Invalid, match="by a known pipe: choose another"):
        _by_board(BOARD, Found(seen(14), SIZE), out)
    out.write_text("")  # a file with nothing in it is nothing to keep
    _by_board(BOARD, Found(seen(14), SIZE), out)
    assert isinstance(load_calibration(out), BoardCalibration)


def test_pairs_are_found_by_their_names(tmp_path: Path) -> None:
    def names(*files: str) -> list[tuple[str, str]]:
        folder = tmp_path / files[0].replace("/", "-")
        for file in files:
            (folder / file).parent.mkdir(parents=True, exist_ok=True)
            (folder / file).touch()
        return [(left.relative_to(folder).as_posix(), right.relative_to(folder).as_posix()) for left, right in pairs_of(folder)]

    assert names("1_L.png", "1_R.png", "2_L.png", "notes_R.txt") == [("1_L.png", "1_R.png")]
    assert names("left/a.jpg", "right/a.jpg", "right/b.jpg") == [("left/a.jpg", "right/a.jpg")]
    assert names("left_07.png", "right_07.png", "board.png") == [("left_07.png", "right_07.png")]
    with pytest.raises(Invalid, match="holds no pairs"):
        names("large.png", "mirror.png")
    with pytest.raises(Invalid, match="no folder"):
        pairs_of(tmp_path / "nowhere")


# --- live ---


def test_a_view_is_kept_where_it_is_still_and_new() -> None:
    places = good_places(np.random.default_rng(0), 3)
    first, second, _ = shown(places)
    gathering = Gathering(BOARD, SIZE)
    assert gathering.take("1", None, first.right) == "no board in the left picture"
    assert gathering.take("1", None, None) == "no board in either picture"
    assert "moving" in gathering.take("1", first.left, first.right)
    assert gathering.take("1", first.left, first.right) == ""
    assert "seen already" in gathering.take("2", first.left, first.right)
    assert "moving" in gathering.take("2", second.left, second.right)
    assert gathering.take("2", second.left, second.right) == ""
    blurred = [replace(one, blur_px=5.0) for one in (first.left, first.right)]
    assert "blurred" in gathering.take("3", *blurred)
    few = Sighting(first.right.ids[:3], first.right.pixels[:3], 1.0)
    assert "too little" in gathering.take("3", first.left, few)
    assert [view.name for view in gathering.views] == ["1", "2"]
    assert gathering.wanted().startswith("show it in the")
    assert not gathering.enough


class Hands:
    """Two cameras before which somebody holds the board: ``views`` one after the other, each in two pictures."""

    name = "pair of cameras"

    def __init__(self, views: list[View], monkeypatch: pytest.MonkeyPatch, ends: type[BaseException] | None = None) -> None:
        self.views, self.number, self.closed, self.ends = views, 0, False, ends
        monkeypatch.setattr(board_views, "sighted", lambda board, left, right: self._sighted())

    def _sighted(self) -> tuple[Sighting, Sighting]:
        view = self.views[min((self.number - 1) // 2, len(self.views) - 1)]
        return view.left, view.right

    def open(self) -> None: ...

    def read(self, timeout_s: float) -> tuple[VideoFrame, VideoFrame]:
        self.number += 1
        if self.ends is not None and self.number > 2 * len(self.views):
            raise self.ends
        if self.number == 3:
            raise FrameTimeout("one was late.")
        image = np.full((SIZE[1], SIZE[0], 3), self.number, np.uint8)
        return VideoFrame(image, self.number, self.number, source="L"), VideoFrame(image, self.number, self.number, source="R")

    def close(self) -> None:
        self.closed = True


def test_views_are_gathered_live_until_there_is_enough(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    hands = Hands(seen(40), monkeypatch)
    found = from_cameras(BOARD, hands, Kept(tmp_path / "kept"))  # type: ignore[arg-type]
    assert hands.closed
    assert found.size == SIZE
    assert 18 <= len(found.views) < 40, "it ends by itself"
    told = capsys.readouterr().err
    assert "covered" in told
    assert "edge nearer" in told
    assert told.rstrip().endswith("that is enough")
    manifest = json.loads((tmp_path / "kept" / "manifest.json").read_text())
    assert len(manifest["pairs"]) == len(found.views)
    assert len(pairs_of(tmp_path / "kept")) == len(found.views)
    calibrated = board_calibrated()
    assert pair_folder(tmp_path / "kept", calibrated).rectifier is not None, "they can be replayed with the calibration"


def board_calibrated() -> Any:
    from drivers.stereo.rectifier import Calibrated

    return Calibrated(lenses(), 0.1, 0.002)


def test_ctrl_c_ends_it_with_what_there_is(monkeypatch: pytest.MonkeyPatch) -> None:
    hands = Hands(seen(4), monkeypatch, ends=KeyboardInterrupt)
    found = from_cameras(BOARD, hands, None)  # type: ignore[arg-type]
    assert 2 <= len(found.views) <= 4
    assert hands.closed
    with pytest.raises(NotEnough, match="usable views"):
        calibrate_pair(BOARD, found.views, found.size)


def test_a_camera_that_goes_away_loses_nothing_of_what_was_shown(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    hands = Hands(seen(4), monkeypatch, ends=SensorLost)
    assert 2 <= len(from_cameras(BOARD, hands, None).views) <= 4  # type: ignore[arg-type]
    assert "is calibrated with" in capsys.readouterr().err
    assert hands.closed


def test_a_board_calibration_says_nothing_of_virtual_pairs(tmp_path: Path) -> None:
    saved = tmp_path / "board.json"
    save_calibration(saved, board_calibration(calibrate_pair(BOARD, seen(20), SIZE), BOARD.name))
    said = CliRunner().invoke(cli, ["anomaly", "--virtual", "--calibration", str(saved)])
    assert isinstance(said.exception, Invalid)
    assert "two plain cameras" in str(said.exception)


def test_a_codec_of_two_letters_is_refused_in_a_sentence(tmp_path: Path) -> None:
    given = ["calibrate", "stereo", "--board", "charuco", "--left", "0", "--right", "1", "--codec", "MJ"]
    said = CliRunner().invoke(cli, [*given, "--out", str(tmp_path / "c.json")])
    assert isinstance(said.exception, Invalid)
    assert "a codec has four letters" in str(said.exception)


def test_a_camera_that_is_not_there_is_told() -> None:
    class Gone(Hands):
        def open(self) -> None:
            raise SensorMissing("There is no frame grabber /dev/video2.")

    with pytest.MonkeyPatch.context() as patch, pytest.raises(SensorMissing, match="video2"):
        from_cameras(BOARD, Gone([], patch), None)  # type: ignore[arg-type]
