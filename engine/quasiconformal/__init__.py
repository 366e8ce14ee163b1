"""Quasi-conformal maps of the plane under control points (section III.D of the paper)."""

from engine.quasiconformal._compatible import compatible_points
from engine.quasiconformal._plane import PreparedPlane
from engine.quasiconformal._solver import (
    Boundary,
    Method,
    QuasiconformalSolver,
    quasiconformal_map,
)

__all__ = [
    "Boundary",
    "Method",
    "PreparedPlane",
    "QuasiconformalSolver",
    "compatible_points",
    "quasiconformal_map",
]
