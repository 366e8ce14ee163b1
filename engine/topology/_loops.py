"""Boundary loops of an oriented triangle list."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from engine.topology._halfedges import origins, targets, twins
from engine.topology._loop_kernels import simple_loops
from engine.types import FloatArray, IntArray


def boundary_loops(faces: IntArray, vertex_count: int) -> tuple[IntArray, ...]:
    """The boundary as simple loops of vertices, the surface on their left.

    ``faces`` (m, 3) must be consistently oriented with at most two faces per edge
    (``TopologyError`` otherwise). A boundary that touches itself at a vertex (a bow-tie) is
    split there: no loop visits a vertex twice, several loops may share one. Loops begin at their
    smallest vertex; the one with the most vertices comes first.
    """
    return tuple(origins(faces)[loop] for loop in edge_loops(faces, twins(faces), vertex_count))


def edge_loops(
    faces: IntArray, twin: IntArray, vertex_count: int, vertices: FloatArray | None = None
) -> list[IntArray]:
    """The same loops as half-edges: element i of a loop ends where element i + 1 starts.

    A boundary that touches itself at two vertices in turn can be split at either: this goes by
    position, if the ``vertices`` are given, not by number.
    """
    start, end = origins(faces), targets(faces)
    rim = np.flatnonzero(twin < 0)
    if vertices is not None:
        rim = rim[np.lexsort((*vertices[end[rim]].T, *vertices[start[rim]].T))]
    joined, bounds = simple_loops(rim, start, end, twin, vertex_count)
    loops: list[IntArray] = []
    for low, high in pairwise(bounds.tolist()):
        loop = joined[low:high]
        loops.append(np.roll(loop, -int(np.argmin(start[loop]))))
    return sorted(loops, key=lambda loop: (-len(loop), start[loop].tolist()))
