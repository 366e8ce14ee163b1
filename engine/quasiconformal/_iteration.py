"""Algorithm 4 of the paper, literally: eqs. (8)-(12)."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from engine.beltrami import BeltramiSolver, beltrami_coefficient
from engine.quasiconformal._newton import Descent
from engine.quasiconformal._plane import PreparedPlane
from engine.types import ComplexArray, IntArray

_LARGEST = 0.95  # of |ν|


def neighbour_average(pairs: IntArray, count: int) -> sp.csr_array:
    """𝒜 of eq. (10): the mean over a face and the faces that share an edge with it.

    ``pairs`` (e, 2) neighbouring faces of ``count``. The face itself counts: without it a
    coefficient that alternates from face to face would never be smoothed.
    """
    one, other = pairs[:, 0], pairs[:, 1]
    itself = np.arange(count)
    rows = np.concatenate([one, other, itself])
    columns = np.concatenate([other, one, itself])
    degree = np.bincount(rows, minlength=count)
    return sp.csr_array((1.0 / degree[rows], (rows, columns)), shape=(count, count))


class LiteralIteration:
    """The first-order fixed-point iteration on one plane; its solver is analysed once."""

    def __init__(self, plane: PreparedPlane, points: IntArray) -> None:
        self._plane = plane
        self._corners = plane.z[plane.faces]
        self._solver = BeltramiSolver(self._corners, plane.faces, points)
        self._average = neighbour_average(plane.hinges.pairs, len(plane.faces))

    def run(self, targets: ComplexArray, *, equalise: bool, tolerance: float, most: int) -> Descent:
        """f₀ = F_b(0), ν₀ = μ(f₀); μ = 𝒜(ν), f = F_b(μ), ν = μ(f) until max |Δν| < tolerance.

        The paper prints 𝒜(δ(ν)) with δ "the matrix of vertex coordinates"; its source (Lui, Lam,
        Yau, Gu 2014) has a projection there: none, or with ``equalise`` |𝒜(ν)| set to its mean,
        the Teichmüller form. |ν| is cut at 0.95, else F_b is not elliptic.
        """
        faces = self._plane.faces
        w = self._solver.solve(np.zeros(len(faces), np.complex128), targets)
        nu = beltrami_coefficient(self._corners, faces, w)
        residuals: list[float] = []
        while len(residuals) + 1 < most and not (residuals and residuals[-1] < tolerance):
            mu: ComplexArray = self._average @ _cut(nu)
            if equalise:
                mu = np.abs(mu).mean() * np.exp(1j * np.angle(mu))
            w = self._solver.solve(mu, targets)
            after = beltrami_coefficient(self._corners, faces, w)
            residuals.append(float(np.abs(after - nu).max()))
            nu = after
        converged = bool(residuals) and residuals[-1] < tolerance
        return Descent(w, tuple(residuals), len(residuals) + 1, converged)


def _cut(nu: ComplexArray) -> ComplexArray:
    size = np.abs(nu)
    cut = np.where(np.isinf(size), _LARGEST, nu)
    large = np.isfinite(size) & (size > _LARGEST)
    cut[large] *= _LARGEST / size[large]
    return cut
