"""``borescout calibrate``: what a rig has to be told before it measures."""

from __future__ import annotations

import re
from pathlib import Path

import click
import cv2

from device.anomaly.calibration import board_calibration, replace_calibration
from device.calibrating.board_paper import PAPERS, board_of, write_board
from device.calibrating.board_views import Found, Kept, from_cameras, from_folder
from device.calibrating.known_pipe import by_known_pipe
from device.errors import Invalid
from drivers.stereo.openers import grabber_pair
from estimators.board.board import KINDS, Board
from estimators.board.calibration import NotEnough, calibrate_pair

_LENGTH = re.compile(r"\s*(\d+(?:\.\d+)?)\s*(mm|cm|m)?\s*", re.ASCII)
_UNITS = {"mm": 0.001, "cm": 0.01, "m": 1.0}
_COUNTS = re.compile(r"\s*(\d{1,5})\s*x\s*(\d{1,5})\s*", re.ASCII)

_kind = click.option("--board", "kind", type=click.Choice(KINDS), help="The board in the pictures.")
_squares = click.option("--squares", default="9x6", show_default=True, help="Its squares across and down.")
_square = click.option("--square", default="30mm", show_default=True, help="The side of a square, as measured on the paper.")


@click.group()
def calibrate() -> None:
    """Calibrate a rig, or print the board for it."""


@calibrate.command()
@click.option("--known-pipe", type=click.Path(path_type=Path), help="A folder of pairs in a pipe of known diameter.")
@click.option("--diameter", help="Its interior diameter, such as 500mm.")
@_kind
@_squares
@_square
@click.option("--pairs", type=click.Path(path_type=Path), help="With --board: a folder of pairs of pictures of it.")
@click.option("--left", help="With --board, live: the V4L2 device of the left camera, such as /dev/video0.")
@click.option("--right", help="The right one's.")
@click.option("--size", default="1280x720", show_default=True, help="With --left and --right: pixels of their pictures.")
@click.option("--codec", help="Four letters such as MJPG, where both cameras share a slow bus.")
@click.option("--keep", type=click.Path(path_type=Path, file_okay=False), help="With --left and --right: save the views here.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="The calibration file to write.")
def stereo(
    known_pipe: Path | None,
    diameter: str | None,
    kind: str | None,
    squares: str,
    square: str,
    pairs: Path | None,
    left: str | None,
    right: str | None,
    size: str,
    codec: str | None,
    keep: Path | None,
    out: Path,
) -> int:
    """A stereo rig: by a round pipe of known diameter its disparity offset and scale, by a board the lenses of two cameras."""
    cv2.setNumThreads(1)
    if (known_pipe is None) == (kind is None):
        raise Invalid("Say what to calibrate with: --known-pipe with --diameter, or --board with --pairs or two cameras.")
    if known_pipe is not None:
        if diameter is None:
            raise Invalid("Say with --diameter how wide the known pipe is.")
        by_known_pipe(known_pipe, length_m(diameter), out)
        return 0
    board = _board(str(kind), squares, square)
    live = left is not None and right is not None and left != right
    if (pairs is not None) == live or (pairs is not None and (left or right or keep)):
        raise Invalid("Say where the views of the board come from: --pairs, or two cameras as --left and --right.")
    if pairs is not None:
        found = from_folder(board, pairs)
    else:
        try:
            width, height = _counts(size)
            cameras = grabber_pair(str(left), str(right), width=width, height=height, codec=codec)
        except ValueError as error:
            raise Invalid(f"The cameras cannot be asked for that: {error}.") from None
        found = from_cameras(board, cameras, None if keep is None else Kept(keep))
    _by_board(board, found, out)
    return 0


@calibrate.command("board")
@_kind
@_squares
@_square
@click.option("--paper", type=click.Choice(list(PAPERS)), default="A4", show_default=True, help="What it is printed on.")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), required=True, help="A .pdf or .png file to write.")
def print_board(kind: str | None, squares: str, square: str, paper: str, out: Path) -> int:
    """Print a board to scale, for calibrate stereo --board."""
    board = _board(kind or KINDS[0], squares, square)
    write_board(board, out, paper)
    click.echo(f"{board.name}: written to {out}. Print it at 100 %, measure it, and glue it on something flat.")
    return 0


def _by_board(board: Board, found: Found, out: Path) -> None:
    """Calibrate with what was found and write the file; a good file stays where this is refused. Raises Invalid."""
    try:
        result = calibrate_pair(board, found.views, found.size)
    except NotEnough as error:
        raise Invalid(str(error)) from None
    for name, off_px in result.left_out:
        click.echo(f"borescout: {name} disagrees with the others by {off_px:.1f} px and is left out.", err=True)
    new = board_calibration(result, board.name)
    replace_calibration(out, new)
    click.echo(
        f"{len(result.views)} views: corners to {result.reprojection_px:.2f} px, rows to {result.epipolar_px:.2f} px, "
        f"disparities ± {result.offset_std_px:.2f} px, baseline {1000 * abs(new.translation_m[0]):.2f} mm ± "
        f"{100 * result.scale_std:.1f} %: written to {out}."
    )


def _board(kind: str, squares: str, square: str) -> Board:
    columns, rows = _counts(squares)
    match = _LENGTH.fullmatch(square)
    return board_of(kind, columns, rows, 0.0 if match is None else float(match[1]) * _UNITS[match[2] or "mm"])


def _counts(text: str) -> tuple[int, int]:
    match = _COUNTS.fullmatch(text)
    if match is None:
        raise Invalid(f"{text} is not written like 9x6.")
    return int(match[1]), int(match[2])


def length_m(text: str) -> float:
    """A length such as "500mm", "50 cm", "0.5m"; without a unit it is millimetres. Raises Invalid."""
    match = _LENGTH.fullmatch(text)
    if match is None or not 0.02 <= float(match[1]) * _UNITS[match[2] or "mm"] <= 10.0:
        raise Invalid(f"{text} is no diameter of a pipe: write it like 500mm.")
    return float(match[1]) * _UNITS[match[2] or "mm"]
