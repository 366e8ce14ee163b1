"""Closest points that prefer compatible normals: many fast queries for iterative registration.

A query finds the vertex nearest in (position, weight · normal) and descends from it over the
surface. Normals keep the two lips and the two eyelids apart; :mod:`engine.locate` answers the
exact Euclidean question.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from engine._edge_kernels import edges_and_uses
from engine._nearest_kernels import descend, described
from engine._operator_kernels import corners_at
from engine.halfedges import edge_keys
from engine.operators import vertex_normals
from engine.types import BoolArray, FloatArray, IntArray, Mesh


@dataclass(frozen=True, slots=True)
class Stars:
    """Which faces surround each vertex (compressed rows), and which vertices are on a border."""

    start: IntArray
    face: IntArray
    border: BoolArray


def vertex_stars(faces: IntArray, vertex_count: int) -> Stars:
    """The stars of ``faces`` (m, 3); used vertices only have non-empty ones."""
    ends, uses = edges_and_uses(*edge_keys(faces))
    border = np.zeros(vertex_count, dtype=np.bool_)
    border[ends[uses == 1]] = True
    return Stars(*corners_at(faces, vertex_count), border)


@dataclass(frozen=True, slots=True)
class Feet:
    """Closest points (k,) of a query: where, how far, the surface's normal there.

    ``on_border`` tells feet on the rim, where the surface ends: the query point may lie beyond it.
    """

    face: IntArray
    barycentric: FloatArray
    position: FloatArray
    normal: FloatArray
    distance: FloatArray
    on_border: BoolArray


class NormalAwareIndex:
    """A surface prepared for closest-point queries by position and normal.

    ``normal_weight`` is the length that a unit of normal difference counts as; ``stars`` may be
    shared between indices over the same faces. Vertices without faces are never found.
    """

    def __init__(self, mesh: Mesh, normal_weight: float, stars: Stars | None = None) -> None:
        self.mesh = mesh
        self.normal_weight = normal_weight
        self.stars = stars or vertex_stars(mesh.faces, len(mesh.vertices))
        self.normals = vertex_normals(mesh)
        self._used = np.flatnonzero(np.diff(self.stars.start) > 0)
        self._tree = KDTree(
            np.hstack((mesh.vertices, normal_weight * self.normals))[self._used],
            leafsize=24,
            balanced_tree=False,
        )

    def feet(self, points: FloatArray, normals: FloatArray) -> Feet:
        """The closest points to ``points`` (k, 3) whose normals resemble ``normals`` (k, 3)."""
        query = np.hstack((points, self.normal_weight * normals))
        return self._below(points, self._used[self._tree.query(query)[1]])

    def feet_beside(self, points: FloatArray, before: Feet) -> Feet:
        """The closest points near the feet ``before``, of points that moved a little since."""
        corner = before.barycentric.argmax(axis=1)
        return self._below(points, self.mesh.faces[before.face, corner])

    def _below(self, points: FloatArray, first: IntArray) -> Feet:
        vertices, faces = self.mesh.vertices, self.mesh.faces
        points = np.ascontiguousarray(points)
        face, barycentric = descend(
            points, first, vertices, faces, (self.stars.start, self.stars.face)
        )
        there = described(
            points, face, barycentric, vertices, self.normals, faces, self.stars.border
        )
        return Feet(face, barycentric, *there)
