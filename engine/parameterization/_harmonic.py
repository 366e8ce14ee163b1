"""Harmonic functions on a triangulation, their values given at some vertices."""

from __future__ import annotations

from typing import cast

import numpy as np

from engine.linalg import ElementPattern, Factor, SymmetricPattern, Values
from engine.parameterization._harmonic_kernels import laplacian_data, laplacian_product
from engine.types import FloatArray, IntArray


class HarmonicSolver:
    """The Dirichlet problem of the Laplacian of ``weights`` (m, 3) at corners of ``faces`` (m, 3).

    Each weight adds to the edge opposite to its corner. Factored once for ``fixed`` (f,) vertices
    of n; the matrix must be positive definite on the others, else ``NumericalError``.
    """

    def __init__(self, faces: IntArray, weights: FloatArray, fixed: IntArray, n: int) -> None:
        free = np.ones(n, dtype=np.bool_)
        free[fixed] = False
        self._faces, self._weights, self._fixed, self._n = faces, weights, fixed, n
        self.free: IntArray = np.flatnonzero(free)
        self._factor: Factor | None = None
        if len(self.free):
            number = np.where(free, np.cumsum(free) - 1, -1)
            pattern = ElementPattern(number[faces], len(self.free))
            data = laplacian_data(weights, pattern.position, pattern.nnz)
            analysis = SymmetricPattern(pattern.indptr, pattern.indices, once=True)
            self._factor = analysis.factor(data)

    def solve(self, values: Values, *, source: Values | None = None) -> Values:
        """x (n,) with x[fixed] = ``values`` (f,) and L x = ``source`` (n,), or 0, elsewhere."""
        x = cast(Values, np.zeros(self._n, dtype=values.dtype))
        x[self._fixed] = values
        if self._factor is not None:
            right = -laplacian_product(self._faces, self._weights, x)[self.free]
            if source is not None:
                right += source[self.free]
            x[self.free] = self._factor.solve(right)
        return x

    def refined(self, x: Values) -> Values:
        """``x`` (n,), which has L x = 0 where it is free, after one step of iterative refinement.

        Where weights differ by many powers of ten (slivers), that takes away most of the rounding.
        """
        zero = cast(Values, np.zeros(len(self._fixed), dtype=x.dtype))
        error = self.solve(zero, source=-laplacian_product(self._faces, self._weights, x))
        return cast(Values, x + error)

    def outflow(self, x: FloatArray) -> FloatArray:
        """The flux (f,) of -grad ``x`` (n,) out of the triangulation at its fixed vertices."""
        return -laplacian_product(self._faces, self._weights, x)[self._fixed]
