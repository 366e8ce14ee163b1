"""Whether a triangulation is one of a disk, without which it has no embedding."""

from __future__ import annotations

import numpy as np

from engine._halfedge_kernels import opposite_halfedges
from engine.errors import ParameterizationError
from engine.parameterization._triangulation_kernels import reached, repeated_halfedges
from engine.types import DiskSurface, IntArray


def require_disk(disk: DiskSurface) -> None:
    """Raise ``ParameterizationError`` (``not_a_disk``), naming faces, if the mesh is no disk.

    No side may belong to two faces in the same direction (an edge with three faces, a repeated
    edge, a face turned over), the faces must hang together across edges, ``boundary`` must be the
    loop of the free sides with the faces on its left, and the Euler characteristic 1.
    """
    faces, n = disk.mesh.faces, len(disk.mesh.vertices)
    repeated = np.flatnonzero(repeated_halfedges(faces, n))
    if len(repeated):
        raise _refusal("share a side with another one in the same direction", repeated)
    opposite = opposite_halfedges(faces, n)
    apart = np.flatnonzero(~reached(opposite))
    if len(apart):
        raise _refusal("do not hang together with the others across edges", apart)
    free = np.flatnonzero(opposite < 0)
    start, end = faces.ravel()[free], np.roll(faces, -1, axis=1).ravel()[free]
    after = np.full(n, -1, dtype=np.int64)
    after[disk.boundary] = np.roll(disk.boundary, -1)
    stray = after[start] != end
    if stray.any() or len(free) != len(disk.boundary):
        raise _refusal("have a free side that is no edge of the boundary loop", free[stray] // 3)
    edges = (len(opposite) + len(free)) // 2
    if n - edges + len(faces) != 1:
        raise _refusal(
            f"make an Euler characteristic of {n - edges + len(faces)}, not 1: vertices without "
            "faces or where two sheets touch",
            np.arange(len(faces)),
        )


def _refusal(what: str, faces: IntArray) -> ParameterizationError:
    return ParameterizationError(
        f"no disk can be laid out: {len(faces)} faces {what}",
        code="not_a_disk",
        elements={"faces": faces[:100].tolist(), "count": len(faces)},
    )
