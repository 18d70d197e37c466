"""A board on paper, to scale: as PDF, or as PNG that says how many pixels a metre it has."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from PIL import Image
from reportlab.lib.pagesizes import A3, A4, landscape
from reportlab.lib.units import mm
from reportlab.lib.utils import ImageReader
from reportlab.pdfgen.canvas import Canvas

from device.errors import Invalid
from estimators.board.board import Board

PAPERS = {"A4": landscape(A4), "A3": landscape(A3)}
_MARGIN_MM = 8.0
"""Printers leave so much blank, and a board needs white about it."""
_PNG_DPI = 600


def board_of(kind: str, columns: int, rows: int, square_m: float) -> Board:
    """A board as somebody describes it. Raises Invalid."""
    try:
        return Board(kind, columns, rows, square_m)
    except ValueError as error:
        raise Invalid(f"This is no board: {error}.") from None


def write_board(board: Board, path: Path, paper: str) -> None:
    """Write ``path``, a .pdf or .png, for ``paper``. Raises Invalid where the board does not fit, or nothing can be written."""
    kinds = {".pdf": lambda: board_pdf(board, paper), ".png": lambda: _png(board)}
    _size(board, paper)
    if path.suffix.lower() not in kinds:
        raise Invalid(f"A board is printed as .pdf or .png, not as {path.name}.")
    try:
        path.write_bytes(kinds[path.suffix.lower()]())
    except OSError as error:
        raise Invalid(f"The board cannot be written to {path}: {error.strerror or error}.") from error


def board_pdf(board: Board, paper: str) -> bytes:
    """One page of ``paper`` (PAPERS) with the board in its middle. Raises Invalid where it does not fit."""
    return _pdf(board, PAPERS[paper], _size(board, paper))


def _size(board: Board, paper: str) -> tuple[float, float]:
    """Across and down, in points. Raises Invalid where ``paper`` is smaller."""
    width, height = PAPERS[paper]
    wide, high = (1000 * board.square_m * count * mm for count in (board.columns, board.rows))
    if wide > width - 2 * _MARGIN_MM * mm or high > height - 2 * _MARGIN_MM * mm:
        raise Invalid(
            f"A board of {wide / mm:.0f} x {high / mm:.0f} mm does not fit on {paper}, {width / mm:.0f} x {height / mm:.0f} mm."
        )
    return wide, high


def _pdf(board: Board, page: tuple[float, float], size: tuple[float, float]) -> bytes:
    buffer = io.BytesIO()
    canvas = Canvas(buffer, pagesize=page, invariant=1)
    canvas.setTitle(f"borescout: {board.name}")
    at = (page[0] - size[0]) / 2, (page[1] - size[1]) / 2
    canvas.drawImage(ImageReader(Image.fromarray(board.picture(100))), *at, *size)
    canvas.setFont("Helvetica", 7)
    told = f"{board.name}. Print at 100 %, measure {size[0] / mm:.0f} mm across, glue it on something flat."
    canvas.drawString(at[0], at[1] - 5 * mm, told)
    canvas.save()
    return buffer.getvalue()


def _png(board: Board) -> bytes:
    """At some 600 dots an inch, with a white square's width about it."""
    square = round(_PNG_DPI * 1000 * board.square_m / 25.4)
    picture = np.pad(board.picture(square), square // 2, constant_values=255)
    buffer = io.BytesIO()
    dpi = square / board.square_m * 0.0254
    Image.fromarray(picture).save(buffer, "PNG", dpi=(dpi, dpi))
    return buffer.getvalue()
