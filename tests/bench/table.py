"""Plain aligned tables on standard output."""

from __future__ import annotations

from collections.abc import Sequence


def print_table(title: str, header: Sequence[str], rows: Sequence[Sequence[object]]) -> None:
    """A titled table: first column to the left, the others to the right."""
    lines = [[str(cell) for cell in row] for row in (header, *rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(header))]
    print(f"\n{title}")
    for number, line in enumerate(lines):
        cells = [
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(line, widths, strict=True))
        ]
        print("  " + "  ".join(cells).rstrip())
        if number == 0:
            print("  " + "  ".join("-" * width for width in widths))


def mm(metres: float | None, digits: int = 1) -> str:
    """Metres as millimetres, a dash for nothing."""
    return "-" if metres is None else f"{metres * 1000:.{digits}f}"


def percent(part: float, whole: float) -> str:
    """A share in percent, a dash where there is nothing to share."""
    return f"{100 * part / whole:.1f} %" if whole else "-"
