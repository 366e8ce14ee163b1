"""A coarser mesh over a subset of a surface's own vertices, its borders kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engine._decimation_kernels import collapse_pass
from engine._operator_kernels import lengths
from engine.nearest import vertex_stars
from engine.operators import edges
from engine.types import FloatArray, IntArray, Mesh

_BORDER_DENSITY = 2.0  # border edges end up this many times shorter than others
_ALIKE = 1e-6  # of the mean length: edges no farther apart are equally long, as are all
_LONGEST = 1e6  # from so many mean lengths on


def decimate(mesh: Mesh, loops: Sequence[IntArray], count: int) -> tuple[IntArray, IntArray]:
    """About ``count`` kept vertices (k,) of ``mesh`` and faces (m, 3) over these.

    Half-edge collapses, shortest edges first, in passes of independent ones; topology and
    orientation stay, border vertices move along their loop only, those of no loop given stay. More
    than ``count`` vertices are left where shape or topology forbid to go on.
    """
    loop_of = np.full(len(mesh.vertices), len(loops))
    for k, loop in enumerate(loops):
        loop_of[loop] = k
    loop_size = np.array([*map(len, loops), 0], dtype=np.int64)
    kept, faces = _compact(np.arange(len(mesh.vertices)), mesh.faces)
    while len(kept) > count:
        before = len(kept)
        now = Mesh(mesh.vertices[kept], faces)
        goes = _collapsed(now, loop_of[kept], loop_size, len(kept) - count)[faces]
        kept, faces = _compact(kept, goes[(goes != goes[:, [1, 2, 0]]).all(axis=1)])
        if len(kept) == before:
            break
    return kept, faces


def _collapsed(mesh: Mesh, loop_of: IntArray, loop_size: IntArray, excess: int) -> IntArray:
    """Where each vertex (n,) goes in one pass; ``loop_size`` is updated."""
    stars = vertex_stars(mesh.faces, len(mesh.vertices))
    pairs = edges(mesh.faces)
    along = stars.border[pairs].all(axis=1)
    length = lengths(mesh.vertices[pairs[:, 0]] - mesh.vertices[pairs[:, 1]])
    shortest = _ascending(np.where(along, _BORDER_DENSITY * length, length))
    return collapse_pass(
        pairs[shortest[: max(len(pairs) * 2 // 3, 1)]],
        (mesh.vertices, mesh.faces),
        (stars.start, stars.face),
        (stars.border, loop_of, loop_size),
        excess,
    )


def _ascending(length: FloatArray) -> IntArray:
    """The order (e,) that sorts lengths, equal ones as they are.

    They are rounded, or rounding would decide between mirror images.
    """
    means = np.minimum(length / length.mean(), _LONGEST)
    steps = np.rint(means / _ALIKE).astype(np.int64)
    return np.sort(steps * len(steps) + np.arange(len(steps))) % len(steps)


def _compact(kept: IntArray, faces: IntArray) -> tuple[IntArray, IntArray]:
    """Those of ``kept`` vertices (n,) that ``faces`` (m, 3) use, and the faces over these."""
    used = np.bincount(faces.ravel(), minlength=len(kept)) > 0
    return kept[used], (np.cumsum(used) - 1)[faces]
