"""Algorithm 5 of the paper: the 3D surface from a few known points and the cotangent Laplacian."""

from __future__ import annotations

import numpy as np

from engine.errors import RestorationError
from engine.linalg import SymmetricPattern
from engine.operators import cotangent_laplacian
from engine.types import FloatArray, IntArray, Mesh


def restore_paper(
    mesh: Mesh, known: IntArray, positions: FloatArray, *, detail: bool = False
) -> FloatArray:
    """Vertices x (n, 3) minimising |W x - b|^2 + sum over ``known`` |x_s - v_s|^2, eqs. (13)-(22).

    W is the cotangent Laplacian of ``mesh``, eq. (13); ``known`` (m,) distinct vertices and their
    ``positions`` v (m, 3). As printed b = 0, which irons a face out unless hundreds of vertices
    are known; ``detail=True`` puts b = W x_source.

    Raises ``RestorationError`` (code ``too_few_known``) without any known vertex.
    """
    if not len(known):
        raise RestorationError(
            "Algorithm 5 needs at least one known vertex: without any, its system is singular",
            code="too_few_known",
        )
    W = cotangent_laplacian(mesh)
    selected = np.zeros(len(mesh.vertices))
    selected[known] = 1.0
    right = W.T @ (W @ mesh.vertices) if detail else np.zeros_like(mesh.vertices)
    right[known] += positions
    pattern, data = SymmetricPattern.of(W.T @ W)
    data[pattern.diagonal] += selected
    return pattern.factor(data).solve(right)
