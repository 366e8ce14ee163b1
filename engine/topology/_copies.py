"""Faces at exactly the same places over vertices of their own: which to keep, what to join."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engine.topology._component_kernels import lowest_in_component
from engine.topology._sheets_kernels import face_areas
from engine.topology._welding import face_kinds, stitch
from engine.topology._welding_kernels import COINCIDENT, DEGENERATE, PROPER, REPEATED
from engine.types import FloatArray, IntArray, Mesh


def kinds_and_joined(mesh: Mesh, position: IntArray) -> tuple[NDArray[np.uint8], IntArray]:
    """(m,) PROPER, DEGENERATE or REPEATED for each face, and the lowest of joined vertices (n,).

    Of coincident faces that one stays whose piece, once stitched, is the largest. Those in pieces
    of the same size are one face: their vertices are joined, so that it hangs together with the
    neighbours of each of them, whichever comes first in the file.
    """
    kinds, like = face_kinds(mesh.faces, position)
    copies = np.flatnonzero(kinds == COINCIDENT)
    joined = np.arange(len(position))
    if not len(copies):
        return kinds, joined
    members = np.union1d(copies, like[copies])
    group, size = like[members], _piece_sizes(mesh, position, kinds != DEGENERATE)[members]
    order = np.lexsort((members, -size, group))
    leads = np.diff(group[order], prepend=-1) > 0
    keeper = members[order[leads]][np.cumsum(leads) - 1]
    members, size = members[order], size[order]
    kinds[members] = REPEATED
    kinds[keeper] = PROPER
    one = size == size[leads][np.cumsum(leads) - 1]
    a, b = (_by_place(mesh.faces[faces[one]], position) for faces in (members, keeper))
    return kinds, lowest_in_component(len(position), a.reshape(-1), b.reshape(-1))


def _piece_sizes(mesh: Mesh, position: IntArray, present: NDArray[np.bool_]) -> FloatArray:
    """(m,) area of the stitched piece of each face; single precision, blind to orders of sums."""
    faces = stitch(mesh.faces[present], position)[mesh.faces]
    a, b, c = faces[present].T
    piece = lowest_in_component(len(position), np.concatenate([a, a]), np.concatenate([b, c]))
    areas = face_areas(mesh.vertices, mesh.faces[present])
    total = np.bincount(piece[a], areas, minlength=len(position)).astype(np.float32)
    return total[piece[faces[:, 0]]].astype(np.float64)


def _by_place(faces: IntArray, position: IntArray) -> IntArray:
    return np.take_along_axis(faces, np.argsort(position[faces], axis=1), axis=1)
