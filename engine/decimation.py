"""A coarser mesh over a subset of a surface's own vertices, its borders kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engine._decimation_kernels import collapse_pass
from engine.nearest import vertex_stars
from engine.operators import edges
from engine.types import IntArray, Mesh

_BORDER_DENSITY = 2.0  # border edges end up this many times shorter than others


def decimate(mesh: Mesh, loops: Sequence[IntArray], count: int) -> tuple[IntArray, IntArray]:
    """About ``count`` kept vertices (k,) of ``mesh`` and faces (m, 3) over these.

    Half-edge collapses, shortest edges first, in passes of independent ones; topology and
    orientation stay, border vertices move along their loop only. More than ``count`` vertices
    are left where shape or topology forbid to go on.
    """
    loop_of = np.full(len(mesh.vertices), -1)
    for k, loop in enumerate(loops):
        loop_of[loop] = k
    loop_size = np.array([len(loop) for loop in loops], dtype=np.int64)
    faces = mesh.faces
    alive = len(np.unique(faces))
    while alive > count:
        stars = vertex_stars(faces, len(mesh.vertices))
        pairs = edges(faces)
        along = stars.border[pairs].all(axis=1)
        length = np.linalg.norm(mesh.vertices[pairs[:, 0]] - mesh.vertices[pairs[:, 1]], axis=1)
        length = np.where(along, _BORDER_DENSITY * length, length)
        length = np.round(length / length.mean(), 6)  # or rounding decides between mirror images
        order = np.argsort(length, kind="stable")[: max(len(pairs) * 2 // 3, 1)]
        goes = collapse_pass(
            pairs[order],
            (mesh.vertices, faces),
            (stars.start, stars.face),
            (stars.border, loop_of, loop_size),
            alive - count,
        )
        removed = int((goes != np.arange(len(goes))).sum())
        if removed == 0:
            break
        faces = goes[faces]
        faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
        alive -= removed
    kept = np.unique(faces)
    number = np.full(len(mesh.vertices), -1)
    number[kept] = np.arange(len(kept))
    return kept, number[faces]
