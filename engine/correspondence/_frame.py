"""Coordinates in which a surface's lengths mean the same whatever its unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.errors import RegistrationError
from engine.operators import face_areas
from engine.types import FloatArray, Mesh


@dataclass(frozen=True, slots=True)
class Frame:
    """Lengths in square roots of a surface's area, origin at its mean vertex."""

    centre: FloatArray
    unit: float

    @classmethod
    def of(cls, mesh: Mesh) -> Frame:
        """The frame of ``mesh``; :class:`RegistrationError` when it has no area."""
        area = float(face_areas(mesh).sum())
        if area <= 0:
            raise RegistrationError(
                "the source surface has no area, so nothing on it can correspond",
                code="no_surface",
                elements={"face_count": len(mesh.faces)},
            )
        return cls(mesh.vertices.mean(axis=0), float(np.sqrt(area)))

    def __call__(self, points: FloatArray) -> FloatArray:
        return (points - self.centre) / self.unit

    def back(self, points: FloatArray) -> FloatArray:
        """From the frame to where the surface is."""
        return points * self.unit + self.centre
