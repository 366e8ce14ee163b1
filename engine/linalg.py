"""Positive definite sparse systems: analyse a pattern once, refactor its values, solve many.

Matrices are held as the lower triangle in CSC form, row indices ascending in each column, every
diagonal entry present.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar, cast

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from engine._pattern_kernels import lower_pattern, scatter
from engine.cholesky import Analysis, analyse, factorise, pivots, solve
from engine.errors import NumericalError
from engine.types import FloatArray, IntArray

Values = TypeVar("Values", NDArray[np.float64], NDArray[np.complex128])

Keep = Callable[[Callable[[], Analysis]], Analysis]
"""Answers with what its argument makes, or with the same from before."""

_LEAST_PIVOT = 4 * np.finfo(np.float64).eps  # of its diagonal entry


class Factor:
    """L Lᵀ of one set of values."""

    def __init__(self, analysis: Analysis, panels: FloatArray) -> None:
        self._analysis = analysis
        self._panels = panels

    def solve(self, right: Values) -> Values:
        """X with A X = ``right`` for right-hand sides (n,) or (n, k), real or complex.

        Raises ``NumericalError`` (code ``not_finite``) when the answer is not finite.
        """
        field = np.complex128 if np.iscomplexobj(right) else np.float64
        columns = np.ascontiguousarray(right, dtype=field).reshape(len(right), -1)
        x = solve(self._analysis, self._panels, columns.view(np.float64))
        if not np.isfinite(x).all():
            raise NumericalError(
                "a linear system has no finite solution: its matrix is singular to working "
                "precision or its right-hand side is not finite",
                code="not_finite",
            )
        return cast(Values, x.view(field).reshape(right.shape))


class SymmetricPattern:
    """The symbolic analysis of a symmetric sparsity pattern.

    ``indptr`` (n+1,) and ``indices`` (nnz,) describe the lower triangle in CSC form as the
    module says. ``diagonal`` (n,) are the positions of the diagonal entries. ``once`` says that
    one set of values will be factored: then an ordering is chosen that is found fast. ``keep``:
    where an analysis of the same pattern may be kept from before.
    """

    def __init__(
        self,
        indptr: IntArray,
        indices: IntArray,
        *,
        once: bool = False,
        keep: Keep | None = None,
    ) -> None:
        self.indptr = indptr
        self.indices = indices
        self.n = len(indptr) - 1
        self.diagonal = indptr[:-1]
        if self.n and not np.array_equal(indices[self.diagonal], np.arange(self.n)):
            raise NumericalError("every column of a symmetric pattern starts with its diagonal")

        def work() -> Analysis:
            return analyse(indptr, indices, once=once)

        self._analysis = work() if keep is None else keep(work)

    @classmethod
    def of(cls, matrix: sp.sparray, *, once: bool = False) -> tuple[SymmetricPattern, FloatArray]:
        """The pattern of a symmetric ``matrix`` (n, n) and its lower values in that order."""
        lower = cast(Any, sp.tril(matrix, format="csc"))
        lower.sort_indices()
        indptr, indices = lower.indptr.astype(np.int64), lower.indices.astype(np.int64)
        return cls(indptr, indices, once=once), lower.data

    def factor(self, data: FloatArray) -> Factor:
        """Factor the values ``data`` (nnz,).

        Raises ``NumericalError`` with the unknown where elimination breaks down:
        ``singular`` when its pivot vanishes to working precision, ``not_definite`` when it is
        negative or not a number.
        """
        panels, unknown, pivot = factorise(self._analysis, data)
        least = _LEAST_PIVOT * np.abs(data[self.diagonal])
        if unknown < 0:
            found = pivots(self._analysis, panels)
            vanishing = np.flatnonzero(found <= least)
            if not len(vanishing):
                return Factor(self._analysis, panels)
            unknown, pivot = int(vanishing[0]), float(found[vanishing[0]])
        code = "singular" if abs(pivot) <= least[unknown] else "not_definite"
        raise NumericalError(
            f"a matrix that must be positive definite has the pivot {pivot:.3g} at unknown"
            f" {unknown}, whose diagonal entry is {data[self.diagonal[unknown]]:.3g}",
            code=code,
            elements={"unknowns": [unknown]},
        )


@dataclass(frozen=True, slots=True)
class ElementPattern:
    """The fixed pattern of a sum of dense blocks, for kernels that assemble into it.

    ``dofs`` (e, k): the unknown behind each local index of each element, -1 for a fixed one;
    ``n`` unknowns. ``position`` (e, k, k): where local entry (i, j) goes in the lower CSC data,
    -1 if it is above the diagonal or fixed; so a kernel adds every entry whose position is >= 0.
    """

    dofs: IntArray
    n: int
    indptr: IntArray = field(init=False)
    indices: IntArray = field(init=False)
    position: IntArray = field(init=False)

    def __post_init__(self) -> None:
        dofs = np.ascontiguousarray(self.dofs, dtype=np.int64)
        indptr, indices, position = lower_pattern(dofs, self.n)
        for name, value in (("indptr", indptr), ("indices", indices), ("position", position)):
            object.__setattr__(self, name, value)

    @property
    def nnz(self) -> int:
        """Stored entries of the lower triangle, every diagonal entry among them."""
        return len(self.indices)

    def assemble(self, blocks: FloatArray) -> FloatArray:
        """Lower CSC data (nnz,) of the sum of symmetric ``blocks`` (e, k, k)."""
        return scatter(self.position, np.ascontiguousarray(blocks), self.nnz)

    def analyse(self, keep: Keep | None = None) -> SymmetricPattern:
        """The symbolic analysis, to be held by whoever factors more than once."""
        return SymmetricPattern(self.indptr, self.indices, keep=keep)


class FixedSolver:
    """The Dirichlet problem: A x = ``source`` at free rows, x given at ``fixed`` ones.

    ``matrix`` (n, n) symmetric, positive definite on the free rows, else ``NumericalError``;
    ``fixed`` (f,) distinct indices. Factored once, solved for any values.
    """

    def __init__(self, matrix: sp.sparray, fixed: IntArray) -> None:
        rows = cast(Any, sp.csr_array(matrix))
        free = np.ones(rows.shape[0], dtype=np.bool_)
        free[fixed] = False
        self.fixed = fixed
        self.free: IntArray = np.flatnonzero(free)
        below = rows[self.free]
        self._coupling = below[:, fixed]
        self._factor: Factor | None = None
        if len(self.free):
            pattern, data = SymmetricPattern.of(below[:, self.free], once=True)
            self._factor = pattern.factor(data)

    def solve(self, values: Values, *, source: Values | None = None) -> Values:
        """x (n,) or (n, k) with x[fixed] = ``values`` (f,) or (f, k).

        ``source``, zero by default, has the shape of x; only its free rows matter.
        """
        n = len(self.free) + len(self.fixed)
        x = np.empty((n, *values.shape[1:]), dtype=values.dtype)
        x[self.fixed] = values
        if self._factor is not None:
            right = -(self._coupling @ values)
            if source is not None:
                right = right + source[self.free]
            x[self.free] = self._factor.solve(right)
        return cast(Values, x)
