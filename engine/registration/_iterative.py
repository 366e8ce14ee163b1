"""Algorithm 2 as printed: iterative closest points between two vertex sets."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from engine.registration._procrustes import best_rotations
from engine.types import FloatArray, Mesh, Registration, Similarity


def matching_rate(rms: FloatArray) -> float:
    """MR = (E_R(1) - E_R(i)) / E_R(1), eq. (5); 1 where nothing was left to improve."""
    return float((rms[0] - rms[-1]) / rms[0]) if rms[0] > 0 else 1.0


def closest_point_registration(
    source: Mesh, target: Mesh, tolerance: float, max_iterations: int
) -> Registration:
    """Besl and McKay's iteration from the pose as given: N moves, M stays, eqs. (1)-(3).

    The paper leaves the unit of d in eq. (3) open. Here its square root, E_R, is measured in
    source diagonals: d itself in squared diagonals would stop at 3 % of the face for τ = 0.001.
    """
    M, N = target.vertices, source.vertices
    goal = tolerance * float(np.linalg.norm(np.ptp(N, axis=0)))
    tree = KDTree(M)
    moved, weights = N, np.ones(len(N))
    rms: list[float] = []
    previous, converged = None, False
    motion = Similarity(np.eye(3), np.zeros(3))
    while len(rms) < max_iterations and not converged:
        closest = tree.query(moved)[1]
        images = M[closest]
        centre_n, centre_m = N.mean(axis=0), images.mean(axis=0)
        R = best_rotations(N - centre_n, images - centre_m, weights)
        moved = (N - centre_n) @ R.T + centre_m
        rms.append(float(np.sqrt(((moved - images) ** 2).sum(axis=1).mean())))
        converged = rms[-1] < goal or (previous is not None and np.array_equal(closest, previous))
        previous, motion = closest, Similarity(R, centre_m - R @ centre_n)
    errors = np.array(rms)
    return Registration(motion.inverse(), errors, matching_rate(errors), len(rms), converged)
