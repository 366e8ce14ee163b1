"""Per-element loops behind the fixed sparsity patterns of ``engine.linalg``."""

from __future__ import annotations

import numpy as np

from engine._jit import kernel
from engine.types import FloatArray, IntArray


@kernel
def lower_pattern(dofs: IntArray, n: int) -> tuple[IntArray, IntArray, IntArray]:
    """Lower CSC pattern of the sum of dense blocks on ``dofs`` (e, k), -1 left out.

    Returns ``indptr`` (n+1,), ``indices`` (nnz,) ascending in each column with the diagonal
    first, and ``position`` (e, k, k): where entry (i, j) of block e goes, -1 if nowhere.
    """
    count, k = dofs.shape
    start = np.zeros(n + 1, np.int64)
    for e in range(count):
        for i in range(k):
            for j in range(k):
                if dofs[e, i] >= dofs[e, j] >= 0:
                    start[dofs[e, j] + 1] += 1
    for c in range(n):
        start[c + 1] += start[c]
    rows = np.empty(start[n], np.int64)
    places = np.empty(start[n], np.int64)
    fill = start[:-1].copy()
    for e in range(count):
        for i in range(k):
            for j in range(k):
                if dofs[e, i] >= dofs[e, j] >= 0:
                    at = fill[dofs[e, j]]
                    rows[at] = dofs[e, i]
                    places[at] = (e * k + i) * k + j
                    fill[dofs[e, j]] += 1
    indptr = np.zeros(n + 1, np.int64)
    indices = np.empty(start[n] + n, np.int64)
    position = np.full(count * k * k, -1, np.int64)
    seen = np.full(n, -1, np.int64)
    nnz = 0
    for c in range(n):
        first = nnz
        indices[nnz] = c
        nnz += 1
        seen[c] = first
        for at in range(start[c], start[c + 1]):
            if seen[rows[at]] < first:
                seen[rows[at]] = nnz
                indices[nnz] = rows[at]
                nnz += 1
        indices[first:nnz].sort()
        for at in range(first, nnz):
            seen[indices[at]] = at
        for at in range(start[c], start[c + 1]):
            position[places[at]] = seen[rows[at]]
        indptr[c + 1] = nnz
    return indptr, indices[:nnz].copy(), position.reshape((count, k, k))


@kernel
def scatter(position: IntArray, blocks: FloatArray, nnz: int) -> FloatArray:
    """Sum of ``blocks`` (e, k, k) at ``position`` (e, k, k) of a data array of length ``nnz``."""
    data = np.zeros(nnz)
    flat = position.ravel()
    values = blocks.ravel()
    for at in range(len(flat)):
        if flat[at] >= 0:
            data[flat[at]] += values[at]
    return data
