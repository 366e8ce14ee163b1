"""Values on a surface averaged over the neighbourhood of each vertex."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from engine.linalg import SymmetricPattern
from engine.operators import cotangent_laplacian, vertex_areas
from engine.types import FloatArray, Mesh


def spread(mesh: Mesh, values: FloatArray, radius: float) -> FloatArray:
    """``values`` (n,) after one implicit step of heat diffusion that reaches ``radius`` far."""
    areas = vertex_areas(mesh)
    areas = np.maximum(areas, 1e-3 * areas.mean())
    diffusion = sp.csr_array(sp.diags_array(areas) + radius**2 * cotangent_laplacian(mesh))
    pattern, data = SymmetricPattern.of(diffusion)
    return pattern.factor(data).solve(areas * values)
