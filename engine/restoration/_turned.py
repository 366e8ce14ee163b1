"""Triangles that an edit turned over or crushed."""

from __future__ import annotations

import numpy as np

from engine.operators import adjacency, face_areas, face_normals
from engine.restoration._rotation_kernels import nearest_rotations
from engine.types import FloatArray, IntArray, Mesh

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

    def __init__(self, mesh: Mesh) -> None:
        self._mesh = mesh
        self._ring = adjacency(mesh.faces, len(mesh.vertices))
        corners = mesh.vertices[mesh.faces]
        self._edge = np.roll(corners, -1, axis=1) - corners
        self._normal = face_normals(mesh)
        self._area = face_areas(mesh)

    def up(self, after: FloatArray, *, rounds: int = _ROUNDS) -> FloatArray:
        """The old unit normals (m, 3), each turned with its neighbourhood to ``after`` (n, 3)."""
        mesh = self._mesh.moved(after)
        return self._up(mesh, face_areas(mesh)[:, None] * face_normals(mesh), rounds)

    def turned(self, after: FloatArray, *, least_area_ratio: float = 1e-3) -> IntArray:
        """The faces inverted or collapsed in ``after`` (n, 3), as ``turned_faces``."""
        mesh = self._mesh.moved(after)
        area = face_areas(mesh)
        normal = area[:, None] * face_normals(mesh)
        upright = np.einsum("ma,ma->m", normal, self._up(mesh, normal, _ROUNDS))
        crushed = area * self._area.sum() < least_area_ratio * self._area * area.sum()
        return np.flatnonzero((self._area > 0) & ((upright < 0) | crushed | (area.sum() == 0)))

    def _up(self, mesh: Mesh, normal: FloatArray, rounds: int) -> FloatArray:
        corners = mesh.vertices[mesh.faces]
        edge = np.roll(corners, -1, axis=1) - corners
        covariance = edge.transpose(0, 2, 1) @ self._edge
        covariance += 4 * normal[:, :, None] * self._normal[:, None, :]
        rotations = nearest_rotations(self._gathered(covariance, rounds))
        return np.einsum("mab,mb->ma", rotations, self._normal)

    def _gathered(self, values: FloatArray, rounds: int) -> FloatArray:
        n = len(self._mesh.vertices)
        flat = np.repeat(values.reshape(-1, 9), 3, axis=0)
        corner = self._mesh.faces.ravel()
        at = np.stack([np.bincount(corner, flat[:, k], n) for k in range(9)], axis=1)
        for _ in range(rounds - 1):
            at = at + self._ring @ at
        return np.ascontiguousarray(at[self._mesh.faces].sum(axis=1)).reshape(-1, 3, 3)
