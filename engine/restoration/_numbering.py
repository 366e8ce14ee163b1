"""A numbering of vertices and faces in which what is near on the surface is near in memory.

Sums over rings and faces of large meshes wait for memory more than they compute, and files number
as they like: by subdivision, by material, at random.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from engine.curve import order_along_curve
from engine.types import FloatArray, Mesh


class Numbering:
    """A ``mesh`` with its vertices along a space-filling curve, its faces by first vertices."""

    def __init__(self, mesh: Mesh) -> None:
        low = mesh.vertices.min(axis=0)
        extent = float((mesh.vertices.max(axis=0) - low).max())
        self._order = order_along_curve(mesh.vertices, low, extent)
        self._rank = np.argsort(self._order)
        faces = self._rank[mesh.faces]
        first = np.argsort(faces.min(axis=1), kind="stable")
        self.mesh = Mesh(mesh.vertices[self._order], faces[first])

    def inside(self, values: FloatArray) -> FloatArray:
        """``values`` (n, ...) of the given mesh's vertices, in this order."""
        return values[self._order]

    def outside(self, values: FloatArray) -> FloatArray:
        """``values`` (n, ...) in this order, as the given mesh's vertices have them."""
        return values[self._rank]

    def columns(self, matrix: sp.csr_array) -> sp.csr_array:
        """A ``matrix`` (k, n) over the given mesh's vertices, over those in this order."""
        entries = matrix.data, self._rank[matrix.indices], matrix.indptr
        return sp.csr_array(entries, shape=matrix.shape)
