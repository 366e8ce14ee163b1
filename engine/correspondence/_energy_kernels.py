"""Assembly loops behind :mod:`engine.correspondence._energy`."""

from __future__ import annotations

from engine._jit import kernel
from engine.types import FloatArray, IntArray


@kernel
def add_vertex_blocks(data: FloatArray, blocks: FloatArray, position: IntArray) -> None:
    """Add symmetric ``blocks`` (n, 3, 3) at the diagonal; ``position`` (n, 6) column by column."""
    for i in range(len(blocks)):
        k = 0
        for column in range(3):
            for row in range(column, 3):
                data[position[i, k]] += blocks[i, row, column]
                k += 1


@kernel
def add_planes(
    system: tuple[FloatArray, FloatArray],
    points: tuple[IntArray, FloatArray],
    planes: tuple[FloatArray, FloatArray],
    positions: tuple[IntArray, IntArray],
) -> None:
    """Add Σ (n·(Σ_k b_k x_k) - d)² to ``system`` = (lower data, right-hand side (n, 3)).

    ``points``: vertices (t, 3) and their b (t, 3), scaled by the root of the term's weight;
    ``planes``: normals n (t, 3) and offsets d (t,), scaled likewise; ``positions``: of the
    diagonal blocks (n, 6), and of the blocks (t, 3, 9) between corners k and k+1 (row: the
    greater vertex).
    """
    corners, weights = points
    normals, offsets = planes
    data, right = system
    diagonal, between = positions
    for t in range(len(corners)):
        for p in range(3):
            i, b = corners[t, p], weights[t, p]
            if b == 0:
                continue
            k = 0
            for column in range(3):
                right[i, column] += b * offsets[t] * normals[t, column]
                for row in range(column, 3):
                    data[diagonal[i, k]] += b * b * normals[t, row] * normals[t, column]
                    k += 1
            c = b * weights[t, (p + 1) % 3]
            if c != 0:
                k = 0
                for column in range(3):
                    for row in range(3):
                        data[between[t, p, k]] += c * normals[t, row] * normals[t, column]
                        k += 1
