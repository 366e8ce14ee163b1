"""A source surface at several resolutions, and how displacements pass between them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from engine._operator_kernels import at_points
from engine.correspondence._energy import DeformableSurface
from engine.decimation import decimate
from engine.nearest import NormalAwareIndex, vertex_stars
from engine.operators import vertex_normals
from engine.types import FloatArray, IntArray, Mesh

_SEARCH_WEIGHT = 0.02  # of normals, when a surface is looked up on itself


@dataclass(frozen=True)
class Level:
    """A decimated surface: ``kept`` (m,) vertices of the full one, and the ``mesh`` over these.

    ``face`` (n,) and ``barycentric`` (n, 3) place every vertex of the full surface on it.
    """

    kept: IntArray
    mesh: Mesh
    face: IntArray
    barycentric: FloatArray

    @cached_property
    def surface(self) -> DeformableSurface:
        """What is solved for on this level."""
        return DeformableSurface(self.mesh)

    @cached_property
    def number(self) -> IntArray:
        """(n,) what the vertices of the full surface are called on this one; -1 for the others."""
        number = np.full(len(self.face), -1)
        number[self.kept] = np.arange(len(self.kept))
        return number

    def restricted(self, loops: Sequence[IntArray]) -> tuple[IntArray, ...]:
        """The full surface's ``loops`` on this one."""
        return tuple(self.number[loop][self.number[loop] >= 0] for loop in loops)

    def prolonged(self, values: FloatArray) -> FloatArray:
        """``values`` (m, …) at this level's vertices, interpolated at the full surface's (n, …)."""
        return interpolated(self.mesh, self.face, self.barycentric, values)

    def below(self, full: Level) -> Level:
        """This level of ``full.mesh`` as a level of the surface that ``full`` is a level of."""
        points = full.prolonged(full.mesh.vertices)
        normals = full.prolonged(vertex_normals(full.mesh))
        face, barycentric = self.place(points, normals)
        return Level(full.kept[self.kept], self.mesh, face, barycentric)

    def place(self, points: FloatArray, normals: FloatArray) -> tuple[IntArray, FloatArray]:
        """The faces and barycentric coordinates of ``points`` (k, 3) at rest on this level."""
        feet = NormalAwareIndex(self.mesh, _SEARCH_WEIGHT).feet(points, normals)
        return feet.face, feet.barycentric


def interpolated(
    mesh: Mesh, face: IntArray, barycentric: FloatArray, values: FloatArray
) -> FloatArray:
    """``values`` (n, …) at the vertices of ``mesh``, linearly in ``face`` (k,): (k, …)."""
    columns = np.ascontiguousarray(values).reshape(len(values), -1)
    there = at_points(face, barycentric, mesh.faces, columns)
    return there.reshape(len(face), *values.shape[1:])


def build_level(mesh: Mesh, loops: Sequence[IntArray], count: int) -> Level:
    """The level with about ``count`` vertices; the mesh itself if it has no more."""
    n = len(mesh.vertices)
    if n <= count:
        first = np.empty(n, dtype=np.int64)
        first[mesh.faces.ravel()] = np.arange(mesh.faces.size)
        corner = np.eye(3)[first % 3]
        return Level(np.arange(n), mesh, first // 3, corner)
    kept, faces = decimate(mesh, loops, count)
    coarse = Mesh(mesh.vertices[kept], faces)
    index = NormalAwareIndex(coarse, _SEARCH_WEIGHT, vertex_stars(faces, len(kept)))
    feet = index.feet(mesh.vertices, vertex_normals(mesh))
    return Level(kept, coarse, feet.face, feet.barycentric)
