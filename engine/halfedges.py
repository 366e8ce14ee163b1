"""Half-edges sorted by the edge that they lie on, whatever is wrong with the faces.

Half-edge 3 f + k runs from corner k of face f to corner k + 1.
"""

from __future__ import annotations

import numpy as np

from engine._edge_kernels import by_lower_end, sort_short_groups
from engine.types import IntArray


def edge_keys(faces: IntArray, place: IntArray | None = None) -> tuple[IntArray, IntArray]:
    """Half-edges sorted by the ends of their edges, as keys, and the bounds of each lower end.

    The ends are vertices, or the ``place`` (n,) of each. Keys as in ``by_lower_end``.
    """
    if place is None:
        place = np.arange(int(faces.max(initial=-1)) + 1)
    keys, bounds = by_lower_end(faces, place)
    for group in sort_short_groups(keys, bounds).tolist():
        keys[bounds[group] : bounds[group + 1]].sort()
    return keys, bounds
