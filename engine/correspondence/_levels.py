"""A source surface at two resolutions, and how displacements pass from the coarser one up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from engine.correspondence._decimation import decimate
from engine.correspondence._energy import DeformableSurface
from engine.nearest import Feet, NormalAwareIndex
from engine.operators import vertex_normals
from engine.types import FloatArray, IntArray, Mesh

_SEARCH_WEIGHT = 0.02  # of normals, when a surface is looked up on itself


@dataclass(frozen=True, slots=True)
class Level:
    """A decimated source: ``number`` (n,) calls its vertices, -1 for those that are gone.

    ``feet`` places every vertex of the full mesh on it.
    """

    surface: DeformableSurface
    number: IntArray
    feet: Feet

    def prolong(self, positions: FloatArray, full: Mesh) -> FloatArray:
        """Positions (n, 3) of the full mesh under this level's displacement."""
        displacement = positions - self.surface.mesh.vertices
        corners = self.surface.mesh.faces[self.feet.face]
        return full.vertices + np.einsum("ki,kij->kj", self.feet.barycentric, displacement[corners])

    def feet_of(self, points: FloatArray, normals: FloatArray) -> Feet:
        """Where ``points`` (k, 3) at rest lie on this level."""
        index = NormalAwareIndex(self.surface.mesh, _SEARCH_WEIGHT, self.surface.stars)
        return index.feet(points, normals)


def build_level(mesh: Mesh, loops: Sequence[IntArray], count: int) -> Level:
    """The level with about ``count`` vertices; the mesh itself if it has no more."""
    n = len(mesh.vertices)
    if n <= count:
        kept, faces = np.arange(n), mesh.faces
    else:
        kept, faces = decimate(mesh, loops, count)
    number = np.full(n, -1)
    number[kept] = np.arange(len(kept))
    surface = DeformableSurface(Mesh(mesh.vertices[kept], faces))
    index = NormalAwareIndex(surface.mesh, _SEARCH_WEIGHT, surface.stars)
    return Level(surface, number, index.feet(mesh.vertices, vertex_normals(mesh)))
