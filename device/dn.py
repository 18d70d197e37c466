"""DN class of a measured interior diameter: tables per material (data/dn_tables.json) and Bayes over them.

DN is a name (ISO 6708). For concrete, clay, ductile iron and GRP it is close to the inside diameter; for plastics it
is the outside one, and the inside is that less two walls, whose thickness follows from the SDR range of the standard.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from math import erf, sqrt

OUT_OF_SERIES_DENSITY = 2e-5
"""Density per millimetre of a pipe that follows no series (old, handmade, relined): what keeps DN from being forced onto any
number."""


@dataclass(frozen=True)
class DnClass:
    """One nominal size of one material with the interior diameters it may have, in millimetres."""

    material: str
    dn: int
    smallest_mm: float
    largest_mm: float
    standard: str

    @property
    def name(self) -> str:
        """As it is said: DN 400."""
        return f"DN {self.dn}"


@dataclass(frozen=True)
class DnGuess:
    """The likeliest class by name, its probability, and the others above 1 %. ``name`` is None where no class fits."""

    name: str | None
    probability: float
    alternatives: tuple[tuple[str, float], ...]


@cache
def classes(material: str | None = None) -> tuple[DnClass, ...]:
    """All classes of ``material``, or of every material where it is not known."""
    tables = json.loads((files("device") / "data" / "dn_tables.json").read_text(encoding="utf-8"))
    found = []
    for name, table in tables.items():
        if material not in (None, "unknown", name):
            continue
        for dn in table["dn"]:
            if table["by"] == "inside":
                low, high = dn * (1 - table["tolerance"]), dn * (1 + table["tolerance"])
            else:
                low, high = dn * (1 - 2 / table["thickest_sdr"]), dn * (1 - 2 / table["thinnest_sdr"])
            found.append(DnClass(name, dn, low, high, table["standard"]))
    return tuple(found)


def known_materials() -> tuple[str, ...]:
    """The materials that have a table."""
    return tuple(dict.fromkeys(c.material for c in classes()))


def guess(diameter_mm: float, std_mm: float, material: str | None = None) -> DnGuess:
    """Posterior over the classes for a measured interior diameter with standard deviation ``std_mm``; equal prior for each
    size."""
    if material not in (None, "unknown", *known_materials()):
        raise ValueError(f"unknown material {material!r}, known: {', '.join(known_materials())}")
    spread = max(std_mm, 0.5)
    table = classes(material)
    per_material = 1 / len({c.material for c in table})
    weight: dict[str, float] = {}
    for c in table:
        share = _probability_within(c, diameter_mm, spread) / max(c.largest_mm - c.smallest_mm, 1.0)
        weight[c.name] = weight.get(c.name, 0.0) + share * per_material / 20
    outside = OUT_OF_SERIES_DENSITY
    total = sum(weight.values()) + outside
    ranked = sorted(((name, w / total) for name, w in weight.items()), key=lambda pair: -pair[1])
    name, probability = ranked[0]
    if outside / total > probability:
        return DnGuess(None, outside / total, tuple(pair for pair in ranked if pair[1] > 0.01))
    return DnGuess(name, probability, tuple(pair for pair in ranked[1:] if pair[1] > 0.01))


def agrees(diameter_mm: float, reference_dn: int, material: str | None, tolerance_mm: float = 20.0) -> bool:
    """Whether a diameter is within ``tolerance_mm`` of what a pipe of ``reference_dn`` may measure inside."""
    candidates = [c for c in classes(material) if c.dn == reference_dn]
    low = min((c.smallest_mm for c in candidates), default=float(reference_dn))
    high = max((c.largest_mm for c in candidates), default=float(reference_dn))
    return low - tolerance_mm <= diameter_mm <= high + tolerance_mm


def _probability_within(c: DnClass, diameter_mm: float, std_mm: float) -> float:
    def below(x: float) -> float:
        return 0.5 * (1 + erf((x - diameter_mm) / (std_mm * sqrt(2))))

    return below(c.largest_mm) - below(c.smallest_mm)
