"""The pipe as a cylinder: found (search), made exact (refinement), judged (assessment)."""

from estimators.cylinder.assessment import CylinderFit, assess
from estimators.cylinder.geometry import Cylinder, orthonormal_basis, wall_points
from estimators.cylinder.search import search

__all__ = ["Cylinder", "CylinderFit", "assess", "orthonormal_basis", "search", "wall_points"]
