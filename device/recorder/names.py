"""How the files of recordings are called: ``survey-000012-01-003.mcap`` is part 3 of the first recording of survey 12."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

_NAME = re.compile(r"survey-(\d{6,})-(\d{2,})-(\d{3,})\.mcap")
SUFFIX = ".mcap"


@dataclass(frozen=True, order=True)
class Name:
    """``take`` counts the recordings of a survey (a second position is a second take), ``part`` the files of a recording."""

    survey: int
    take: int
    part: int

    def __str__(self) -> str:
        return f"survey-{self.survey:06d}-{self.take:02d}-{self.part:03d}{SUFFIX}"


def name_of(path: Path) -> Name | None:
    """What the file's name says, None for another kind of file."""
    found = _NAME.fullmatch(path.name)
    return None if found is None else Name(*(int(number) for number in found.groups()))


def recordings_in(folder: Path) -> list[Path]:
    """The recordings of a folder, oldest first; a foreign file's name says nothing of its age and it comes last."""
    found = [path for path in folder.glob(f"*{SUFFIX}") if path.is_file()]
    return sorted(found, key=lambda path: (name_of(path) is None, name_of(path) or path.name))


def parts_of(path: Path) -> tuple[Path, ...]:
    """All files of the recording that ``path`` is a part of, in order."""
    name = name_of(path)
    if name is None:
        return (path,)
    named = [(other, name_of(other)) for other in recordings_in(path.parent)]
    return tuple(other for other, told in named if told is not None and (told.survey, told.take) == (name.survey, name.take))
