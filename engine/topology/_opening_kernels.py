"""Growing a patch of faces that stays a disk."""

from __future__ import annotations

import heapq

import numpy as np

from engine._jit import kernel
from engine.types import BoolArray, FloatArray, IntArray


@kernel
def grown_disk(
    faces: IntArray,
    twin: IntArray,
    distance: FloatArray,
    wanted: BoolArray,
    keep: BoolArray,
) -> BoolArray:
    """Faces of a patch around the one of least ``distance``, nearest first.

    It grows over the faces ``wanted``. A face is added only where that leaves the patch a disk
    with a simple boundary (a shelling) and puts no vertex of ``keep`` inside. Faces with two sides
    on the patch are taken in as well, so that the rest has no ears.
    """
    inside = np.zeros(len(faces), dtype=np.bool_)
    touched = np.zeros(len(keep), dtype=np.bool_)
    left = len(faces)
    seed = np.argmin(distance)
    heap = [(distance[seed], seed)]
    begun = False
    while heap:
        _, f = heapq.heappop(heap)
        if inside[f] or left <= 2:
            continue
        shared = 0
        free_side = -1
        joined_side = -1
        for k in range(3):
            g = twin[3 * f + k] // 3
            if inside[g]:
                shared += 1
                joined_side = k
            else:
                free_side = k
        if shared == 1:
            if not wanted[f] or touched[faces[f, (joined_side + 2) % 3]]:
                continue
        elif shared == 2:
            if keep[faces[f, (free_side + 2) % 3]]:
                continue
        elif begun:
            continue
        inside[f] = True
        left -= 1
        begun = True
        for k in range(3):
            touched[faces[f, k]] = True
            g = twin[3 * f + k] // 3
            if not inside[g]:
                heapq.heappush(heap, (distance[g], g))
    return inside
