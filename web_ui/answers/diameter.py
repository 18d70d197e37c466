"""The diameter survey while it runs."""

from web_ui.answers.base import Answer


class Live(Answer):
    """The live estimate of the best camera."""

    camera: str
    frame: int
    age_s: float


class Cylinder(Answer):
    """The fitted cylinder: a point of its axis, the axis' direction, and the radius, in metres of the camera frame."""

    axis: list[float]
    point: list[float]
    radius: float


class Cloud(Answer):
    """At most 3000 points (m), with 1 for each that lies on the cylinder."""

    points: list[list[float]]
    inlier: list[int]
    cylinder: Cylinder | None
