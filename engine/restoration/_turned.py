"""Triangles that an edit turned over or crushed."""

from __future__ import annotations

import numpy as np

from engine._operator_kernels import doubled_normals, lengths
from engine.operators import Rings, face_areas, face_normals
from engine.restoration._rotation_kernels import face_covariances
from engine.restoration._turned_kernels import inverted, turned_normals
from engine.types import BoolArray, FloatArray, IntArray, Mesh

_ROUNDS = 2  # rings of faces whose common rotation a face is compared with
_LEAST_AREA_RATIO = 1e-3


def turned_faces(
    mesh: Mesh, before: FloatArray, after: FloatArray, *, least_area_ratio: float = 1e-3
) -> IntArray:
    """Faces of ``after`` (n, 3) inverted or collapsed relative to ``before`` (n, 3).

    Inverted: the normal points against its old self turned with the neighbourhood. Collapsed:
    the area fell below ``least_area_ratio`` of the old one, after scaling to equal total area.
    Faces without area before are not judged.
    """
    return Orientation(mesh.moved(before)).turned(after, least_area_ratio=least_area_ratio)


class Orientation:
    """Which side of a mesh's faces is up, for any number of edits of its vertices."""

    def __init__(self, mesh: Mesh, rings: Rings | None = None) -> None:
        self._mesh = mesh
        self.rings = rings or Rings.of(mesh.faces, len(mesh.vertices))
        self._normal = face_normals(mesh)
        self._area = face_areas(mesh)

    def up(self, after: FloatArray, *, rounds: int = _ROUNDS) -> FloatArray:
        """The old unit normals (m, 3), each turned with its neighbourhood to ``after`` (n, 3)."""
        return turned_normals(self._mesh.faces, self._motion(after, rounds), self._normal)

    def _motion(self, after: FloatArray, rounds: int) -> FloatArray:
        """How each vertex's faces, and those in rings around them, turn to ``after``: (n, 9)."""
        mesh = self._mesh
        sums = face_covariances(mesh.faces, mesh.vertices, after, self._normal)
        return self.rings.sums(sums, rounds - 1)

    def around(self, faces: IntArray, rings: int) -> BoolArray:
        """The vertices (n,) of ``faces``, and those up to so many rings around them."""
        near = np.zeros(len(self._mesh.vertices), dtype=np.bool_)
        near[self._mesh.faces[faces]] = True
        return self.rings.grown(near, rings)

    def turned(self, after: FloatArray, *, least_area_ratio: float = 1e-3) -> IntArray:
        """The faces inverted or collapsed in ``after`` (n, 3), as ``turned_faces``."""
        doubled = doubled_normals(after, self._mesh.faces)
        area = 0.5 * lengths(doubled)
        turned = inverted(self._mesh.faces, self._motion(after, _ROUNDS), self._normal, doubled)
        crushed = area * self._area.sum() < least_area_ratio * self._area * area.sum()
        return np.flatnonzero((self._area > 0) & (turned | crushed | (area.sum() == 0)))
