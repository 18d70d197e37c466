"""Numbers and codes as the operator reads them on a server-rendered page."""

from typing import Any

QUESTIONS = {
    "image_good": "Is the picture sharp, clean and well lit?",
    "cloud_is_pipe": "Does the point cloud look like a pipe?",
    "fit_aligned": "Does the fitted cylinder lie on the points?",
}
CLASSES = ("connection", "deposit", "displaced joint", "fracture", "roots")
"""What may be marked by hand with one tap; anything else is typed."""
_MONTHS = ("Jan", "Feb", "Mar", "Apr", "May", "Jun", "Jul", "Aug", "Sep", "Oct", "Nov", "Dec")
_POSITIONS = {"entrance": "in front of the pipe", "top": "top of the pipe", "middle": "middle of the pipe"}
_JOURNAL_ICONS = {
    "begin": "play",
    "measure": "target",
    "end": "end",
    "cut": "warning",
    "held": "pause",
    "released": "play",
    "drop": "bin",
}
_REASONS = {
    "no_pipe": "no pipe in view",
    "few_points": "too few points",
    "aim": "aim",
    "motion": "movement",
    "unstable": "unstable radius",
    "wide_interval": "interval too wide",
    "water": "water or deposit",
    "camera_lost": "camera lost",
    "second_position": "second position needed",
    "pair_dark": "too dark",
    "pair_bright": "over-exposed",
    "pair_blurred": "out of focus",
    "pair_near": "too near",
    "pair_aside": "off the axis",
    "pair_too_smooth": "wall too smooth",
    "pair_no_match": "pictures do not match",
    "pair_no_wall": "no pipe in view",
    "pair_too_short": "too short a piece of wall",
    "pair_one_sided": "wall on one side only",
    "pair_not_smooth": "no sound profile",
    "pair_moved": "movement",
    "pair_lost": "camera lost",
}


def millimetres(value: float | None, digits: int = 0) -> str:
    """A length in millimetres, or a dash where there is no number."""
    return "–" if value is None else f"{value:.{digits}f}"


def percent(value: float | None) -> str:
    """A share in percent; what is short of certain never reads as 100 %."""
    if value is None:
        return "–"
    if 0.995 <= value < 1:
        return ">\u00a099\u00a0%"
    if 0 < value < 0.005:
        return "<\u00a01\u00a0%"
    return f"{100 * value:.0f}\u00a0%"


def position(code: str | None) -> str:
    """Where the box stood; an unknown code reads as itself."""
    return "not stated" if code is None else _POSITIONS.get(code, code)


def reason(code: str) -> str:
    """A refusal's reason; an unknown code reads as itself."""
    return _REASONS.get(code, code.replace("_", " "))


def when(survey: dict[str, Any]) -> str:
    """When a survey was made, in UTC (the page's module turns it into the browser's time zone), or that nobody knew."""
    created = survey.get("created")
    if not created:
        return "time unknown"
    date, _, time = str(created).partition("T")
    year, month, day = date.split("-")
    return f"{int(day)} {_MONTHS[int(month) - 1]} {year}, {time[:5]} UTC"


def pipe_name(survey: dict[str, Any]) -> str:
    """The pipe of a survey's summary."""
    return survey.get("pipe") or "no pipe stated"


def megabytes(size: int) -> str:
    """The size of a file."""
    if size < 1e6:
        return f"{size / 1e3:.0f} kB"
    return f"{size / 1e6:.1f} MB" if size < 1e9 else f"{size / 1e9:.2f} GB"


def journal_icon(entry: dict[str, Any]) -> str:
    """The icon of one line of the journal."""
    return _JOURNAL_ICONS.get(entry["what"], "dot")


def metres(value: float | None, digits: int = 2) -> str:
    """A length in metres, or a dash where there is no number."""
    return "–" if value is None else f"{value:.{digits}f}"


def span_m(survey: dict[str, Any]) -> str:
    """The stretch of pipe that a drive has seen; empty where it has seen none."""
    low, high = survey.get("from_m"), survey.get("to_m")
    return "" if low is None or high is None else f"{low:.1f} to {high:.1f} m"


def duration(seconds: float | None) -> str:
    """A time as it is spoken of: "48 s", "3 min 20 s"."""
    if seconds is None:
        return "–"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest} s" if minutes else f"{rest} s"
