"""Assembly loops behind :mod:`engine.correspondence._energy`."""

from __future__ import annotations

from engine._jit import kernel
from engine.types import FloatArray, IntArray


@kernel
def add_pulls(
    system: tuple[FloatArray, FloatArray],
    points: tuple[IntArray, FloatArray],
    pulls: tuple[FloatArray, FloatArray],
    positions: tuple[IntArray, IntArray],
) -> None:
    """Add Σ (Σ_k b_k d_k - g)ᵀ B (Σ_k b_k d_k - g) to ``system`` = (lower data, right (n, 3)).

    ``points``: vertices (t, 3) and their b (t, 3); ``pulls``: symmetric B (t, 3, 3) and B g
    (t, 3); ``positions``: of the diagonal blocks (n, 6), column by column, and of the blocks
    (t, 3, 9) between corners k and k+1 (row: the greater vertex).
    """
    corners, weights = points
    blocks, pulled = pulls
    data, right = system
    diagonal, between = positions
    for t in range(len(corners)):
        for p in range(3):
            i, b = corners[t, p], weights[t, p]
            if b == 0:
                continue
            k = 0
            for column in range(3):
                right[i, column] += b * pulled[t, column]
                for row in range(column, 3):
                    data[diagonal[i, k]] += b * b * blocks[t, row, column]
                    k += 1
            c = b * weights[t, (p + 1) % 3]
            if c != 0:
                k = 0
                for column in range(3):
                    for row in range(3):
                        data[between[t, p, k]] += c * blocks[t, row, column]
                        k += 1


@kernel
def spread_to_corners(
    corners: IntArray, weights: FloatArray, values: FloatArray, sums: FloatArray
) -> None:
    """Add ``weights`` (t, 3) times ``values`` (t, 3, k) at vertices ``corners`` to ``sums``."""
    for t in range(len(corners)):
        for p in range(3):
            w = weights[t, p]
            if w != 0:
                sums[corners[t, p]] += w * values[t]
