"""Pipe joints: rings in one picture, the camera's offset from them, and the joints of a run with f R."""

from estimators.rings.bends import JointRing, joint_centres, ring_centres
from estimators.rings.find import Ring, RingConfig, dark_centre, find
from estimators.rings.joints import FocalRadius, JointConfig, JointMap, JointPlace, RingMap
from estimators.rings.offset import AxisView, axis_view

__all__ = [
    "AxisView",
    "FocalRadius",
    "JointConfig",
    "JointMap",
    "JointPlace",
    "JointRing",
    "Ring",
    "RingConfig",
    "RingMap",
    "axis_view",
    "dark_centre",
    "find",
    "joint_centres",
    "ring_centres",
]
