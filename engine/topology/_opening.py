"""Opening a closed surface along its edges."""

from __future__ import annotations

import numpy as np

from engine.topology._cut import Cut
from engine.topology._halfedges import twins
from engine.topology._opening_kernels import grown_disk
from engine.types import BoolArray, IntArray, Mesh


def opening_patch(mesh: Mesh, cut: Cut, keep: IntArray | None) -> BoolArray:
    """Faces (m,) of a disk-shaped patch of a closed mesh to take out: those that reach into the
    ball of ``cut``, as far as none of the vertices ``keep`` is inside the patch."""
    corners = mesh.vertices[mesh.faces] - cut.pole
    reached = (np.einsum("fkx,fkx->fk", corners, corners) < cut.radius**2).any(axis=1)
    away = np.linalg.norm(corners.mean(axis=1), axis=1)
    kept = np.zeros(len(mesh.vertices), dtype=np.bool_)
    if keep is not None:
        kept[keep] = True
    return grown_disk(mesh.faces, twins(mesh.faces), away, reached, kept)
