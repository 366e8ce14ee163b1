"""A numbering of vertices and faces in which what is near on the surface is near in memory.

Sums over rings and faces of large meshes wait for memory more than they compute, and files number
as they like: by subdivision, by material, at random.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from engine.curve import order_along_curve
from engine.types import FloatArray, IntArray, Mesh, Surface, SurfacePoints


class Numbering:
    """A ``mesh`` with its vertices along a space-filling curve, its faces by first vertices.

    The same for every order of the given mesh's vertices and faces, unless vertices share a place.
    ``faces`` (m,) are the given mesh's, as they come here; their corners stay in order.
    """

    def __init__(self, mesh: Mesh) -> None:
        low = mesh.vertices.min(axis=0)
        extent = float((mesh.vertices.max(axis=0) - low).max())
        self._order = order_along_curve(mesh.vertices, low, extent)
        self._rank = np.argsort(self._order)
        faces = self._rank[mesh.faces]
        self.faces: IntArray = np.lexsort(np.sort(faces, axis=1).T[::-1])
        self.mesh = Mesh(mesh.vertices[self._order], faces[self.faces])

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

    def surface(self, surface: Surface) -> Surface:
        """The given mesh's ``surface``, on this one; its loops begin at their first vertices."""
        vertex_of = surface.vertex_of.copy()
        vertex_of[vertex_of >= 0] = self._rank[vertex_of[vertex_of >= 0]]
        loops = [self._rank[loop] for loop in surface.loops]
        turned = tuple(np.roll(loop, -int(loop.argmin())) for loop in loops)
        return Surface(self.mesh, vertex_of, surface.face_of[self.faces], turned)

    def points_inside(self, points: SurfacePoints) -> SurfacePoints:
        """``points`` of the given mesh, on this one."""
        rank = np.argsort(self.faces)
        return SurfacePoints(rank[points.face], points.barycentric)

    def points_outside(self, points: SurfacePoints) -> SurfacePoints:
        """``points`` of this mesh, on the given one."""
        return SurfacePoints(self.faces[points.face], points.barycentric)
