"""The best rotation between paired points."""

from __future__ import annotations

import numpy as np

from engine.types import FloatArray


def best_rotations(points: FloatArray, images: FloatArray, weights: FloatArray) -> FloatArray:
    """Rotations (..., 3, 3) that minimise Σ w |R p - q|² over centred p, q (..., k, 3).

    Steps 3-4 of Algorithm 2: singular value decomposition of the covariance matrix
    (Arun, Huang and Blostein 1987), reflections excluded.
    """
    covariance = np.einsum("...k,...ki,...kj->...ij", weights, images, points)
    U, _, Vt = np.linalg.svd(covariance)
    U[..., :, 2] *= np.sign(np.linalg.det(U @ Vt))[..., None]
    return U @ Vt
