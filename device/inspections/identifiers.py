"""Identifiers of pipes and manholes: built from the manholes' names, judged while they are typed."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass

LONGEST = 30
"""Letters that ISYBAU's Objektbezeichnung and the pipe reference of EN 13508-2 (AAA) hold."""
_ENCODING = "ISO-8859-1"


@dataclass(frozen=True)
class Judged:
    """An identifier, what forbids it (or None) and what its user should look at before it is kept."""

    name: str
    error: str | None
    warnings: tuple[str, ...] = ()


def of_pipe(upstream: str, downstream: str) -> str:
    """A pipe's identifier from its manholes: upstream and downstream joined by a hyphen, which every format can write."""
    return "-".join(part for part in (upstream.strip(), downstream.strip()) if part)


def judge_node(name: str, others: Collection[str]) -> Judged:
    """A manhole's name beside those of the ``others``."""
    name = name.strip()
    if not name:
        return Judged(name, "Name the manhole.")
    if name in others:
        return Judged(name, f"There is already a manhole called {name}.")
    return Judged(name, None, (*_alike(name, others, "manhole"), *_unwritable(name)))


def judge_pipe(
    name: str, upstream: str, downstream: str, others: Mapping[str, tuple[str, str]], manholes: Collection[str]
) -> Judged:
    """A pipe's name (empty: built from its manholes) beside the ``others``, each with its manholes, and all ``manholes``."""
    ends = upstream.strip(), downstream.strip()
    name = name.strip() or of_pipe(*ends)
    if not name:
        return Judged(name, "Name the pipe, or one of its manholes.")
    if ends[0] and ends[0] == ends[1]:
        return Judged(name, f"A pipe joins two manholes; both of this one are called {ends[0]}.")
    if name in others:
        return Judged(name, f"There is already a pipe called {name}.")
    new = [end for end in ends if end and end not in manholes]
    warnings = [warning for end in new for warning in _alike(end, manholes, "manhole")]
    warnings += [] if warnings else _alike(name, others, "pipe")  # a manhole's slip is the pipe's
    warnings += [warning for text in (name, *new) for warning in _unwritable(text)]
    if all(ends):
        warnings += [
            f"{ends[0]} and {ends[1]} are already joined by the pipe {other}."
            for other, joined in others.items()
            if set(joined) == set(ends)
        ]
    return Judged(name, None, tuple(warnings))


def _alike(name: str, others: Collection[str], what: str) -> Iterator[str]:
    """Names that differ in case, spaces, signs or leading zeros only are mostly slips."""
    wanted = _heard(name)
    for other in others:
        if wanted and other != name and _heard(other) == wanted:
            yield f"There is a {what} called {other}: is {name} another one?"


def _heard(name: str) -> tuple[str, ...]:
    """``name`` as it is said: its words and numbers."""
    return tuple(part.lstrip("0") or "0" for part in re.findall(r"[^\W\d_]+|\d+", name.casefold()))


def _unwritable(name: str) -> Iterator[str]:
    if (letters := len(name)) > LONGEST:
        yield f"{name} has {letters} letters; ISYBAU and EN 13508-2 files hold {LONGEST}: a report of it could not be written."
    try:
        name.encode(_ENCODING)
    except UnicodeEncodeError as error:
        yield f"{name[error.start]} in {name} cannot be written in ISYBAU and EN 13508-2 files ({_ENCODING})."
