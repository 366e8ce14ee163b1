"""Values on a surface averaged over the neighbourhood of each vertex."""

from __future__ import annotations

from dataclasses import dataclass

import scipy.sparse as sp

from engine.linalg import Factor, SymmetricPattern
from engine.operators import cotangent_laplacian, vertex_areas
from engine.types import FloatArray, Mesh


@dataclass(frozen=True, slots=True)
class Spreading:
    """One implicit step of heat diffusion over a surface, factorised for any values."""

    areas: FloatArray
    factor: Factor

    @classmethod
    def over(cls, mesh: Mesh, radius: float) -> Spreading:
        """The step that reaches ``radius`` far."""
        areas = vertex_areas(mesh)
        areas = areas.clip(1e-3 * areas.mean())
        diffusion = sp.csr_array(sp.diags_array(areas) + radius**2 * cotangent_laplacian(mesh))
        pattern, data = SymmetricPattern.of(diffusion)
        return cls(areas, pattern.factor(data))

    def __call__(self, values: FloatArray) -> FloatArray:
        """``values`` (n,) after the step."""
        return self.factor.solve(self.areas * values)
