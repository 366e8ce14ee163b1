"""Refusing faces that make no surface at all, before anything large is made of them."""

from __future__ import annotations

import numpy as np

from engine._edge_kernels import edge_counts
from engine.errors import TopologyError
from engine.halfedges import edge_keys
from engine.topology._component_kernels import lowest_face
from engine.topology._sheets_kernels import face_areas
from engine.types import FloatArray, IntArray

LEAST_SHARE = 1e-3
"""Of all area, or of all edges: what a surface among debris has of it at least."""


def refuse_scattered(vertices: FloatArray, faces: IntArray, position: IntArray) -> None:
    """Raise ``TopologyError`` if hardly any face continues another, or all pieces are tiny.

    Faces hang together here wherever edges are at the same place, so no piece of what follows is
    larger; and one edge, however many faces it has, joins two of them.
    """
    piece = _pieces(faces, position)
    area = np.bincount(piece, face_areas(vertices, faces))
    if area.max(initial=0.0) < LEAST_SHARE * area.sum():
        count = int(np.count_nonzero(piece == np.arange(len(piece))))
        raise _scattered(f"of {count} pieces none has more than a thousandth of the area")


def _pieces(faces: IntArray, position: IntArray) -> IntArray:
    """The lowest face that each one hangs together with."""
    keys, bounds = edge_keys(faces, position)
    lone, joining, crowded = edge_counts(keys, bounds)
    if joining + crowded + 1 < LEAST_SHARE * lone:
        raise _scattered(f"{lone} edges have one face, only {joining + crowded} have more")
    return lowest_face(keys, bounds)


def _scattered(what: str) -> TopologyError:
    return TopologyError(
        f"the faces make no surface: {what}. Export them with common vertices, or the face alone",
        code="not_a_surface",
    )
