"""How a virtual pipe and the camera in it look: all that changes the picture but not what lies where."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

Color = tuple[float, float, float]
"""Blue, green, red; 1 is white in full light."""


@dataclass(frozen=True)
class Look:
    """``wall``, ``dirt`` and ``water`` are colours; ``pieces`` is how much one length of pipe differs
    from the next, ``grain``, ``stains`` and ``specks`` how lively the wall is; ``dirt_line``
    (rad) is how far up the invert's dirt goes to either side.

    ``ripples`` is how steep the water's surface is (rad). ``joint`` is how dark a joint's gap is (0 black, 1 as the wall) and
    ``rim`` how bright its edge. ``lamp`` is the brightness, ``reach`` how far the light goes, in diameters, ``falloff`` how
    fast it ends, ``lamp_angle`` and ``lamp_side`` where it is stronger and by how much. ``haze`` is fog lit by the lamp.
    ``blur`` (px), ``noise`` (grey levels), ``jpeg`` (quality), ``interlace`` and ``text`` are the camera's and the recorder's.
    """

    material: str = "concrete"
    wall: Color = (0.52, 0.58, 0.62)
    dirt: Color = (0.24, 0.33, 0.40)
    water: Color = (0.10, 0.13, 0.13)
    pieces: float = 0.06
    grain: float = 0.1
    stains: float = 0.14
    specks: float = 0.3
    dirt_line: float = 0.6
    ripples: float = 0.05
    joint: float = 0.2
    rim: float = 1.5
    lamp: float = 2.6
    reach: float = 4.0
    falloff: float = 2.0
    lamp_angle: float = -1.6
    lamp_side: float = 0.12
    haze: float = 0.03
    blur: float = 0.7
    noise: float = 3.0
    jpeg: int = 80
    interlace: bool = True
    text: bool = False


_MATERIALS: dict[str, tuple[Color, ...]] = {
    "concrete": ((0.52, 0.58, 0.62), (0.50, 0.60, 0.66), (0.62, 0.62, 0.60), (0.38, 0.52, 0.60), (0.42, 0.56, 0.58)),
    "clay": ((0.24, 0.34, 0.60), (0.30, 0.42, 0.66), (0.26, 0.27, 0.72), (0.34, 0.52, 0.66)),
    "pvc": ((0.72, 0.76, 0.78), (0.50, 0.58, 0.24), (0.30, 0.48, 0.78), (0.70, 0.66, 0.58), (0.60, 0.70, 0.72)),
}


def random_look(rng: np.random.Generator, text: bool | None = None) -> Look:
    """Some pipe, some lamp, some camera."""
    material = str(rng.choice(list(_MATERIALS), p=[0.45, 0.3, 0.25]))
    palette = _MATERIALS[material]
    tint = np.clip(rng.normal(1, 0.06, 3), 0.8, 1.2)
    wall = np.clip(np.array(palette[int(rng.integers(len(palette)))]) * tint * rng.uniform(0.85, 1.1), 0.05, 1)
    brown = np.array([0.20, 0.30, 0.38]) * rng.uniform(0.6, 1.3) * np.clip(rng.normal(1, 0.1, 3), 0.7, 1.3)
    rough = {"concrete": 1.0, "clay": 0.6, "pvc": 0.35}[material]
    found = Look(
        material=material,
        wall=_color(wall),
        dirt=_color(brown),
        water=_color(brown * rng.uniform(0.3, 0.8)),
        pieces=float(rng.uniform(0.0, 0.12)),
        grain=0.14 * rough * float(rng.uniform(0.6, 1.3)),
        stains=0.16 * float(rng.uniform(0.5, 1.4)) * rough**0.5,
        specks=float(rng.uniform(0.05, 0.9)),
        dirt_line=float(rng.uniform(0.1, 1.3)),
        ripples=float(rng.uniform(0.01, 0.06)),
        joint=float(rng.uniform(0.05, 0.5)),
        rim=float(rng.uniform(1.0, 2.2)),
        lamp=float(rng.uniform(1.6, 4.0)),
        reach=float(rng.uniform(2.0, 6.5)),
        falloff=float(rng.uniform(1.5, 2.6)),
        lamp_angle=float(rng.uniform(-np.pi, np.pi)),
        lamp_side=float(rng.uniform(0.0, 0.25)),
        haze=float(rng.choice([0.0, 0.03, 0.1, 0.2], p=[0.4, 0.35, 0.2, 0.05])),
        blur=float(rng.uniform(0.4, 1.6)),
        noise=float(rng.uniform(1.0, 6.0)),
        jpeg=int(rng.integers(45, 93)),
        interlace=bool(rng.random() < 0.5),
    )
    return replace(found, text=bool(rng.random() < 0.5) if text is None else text)


def _color(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> Color:
    b, g, r = (float(np.clip(value, 0.02, 1.0)) for value in values)
    return b, g, r
