"""Point location: the nearest point of a mesh in space, the triangle of a point in the plane."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from engine._halfedge_kernels import opposite_halfedges
from engine._locate_kernels import LEAF, nearest_points, walked_to
from engine.curve import order_along_curve
from engine.errors import EngineError
from engine.types import ComplexArray, FloatArray, IntArray, Mesh, SurfacePoints

_MOST_STEPS = 50
_ON_A_SIDE = 1e-12  # barycentric weight: rounding may put the point into the next face


class PointLocator:
    """Answers nearest-point queries on one mesh; build once, ask often."""

    def __init__(self, mesh: Mesh) -> None:
        """Sort the faces along a space-filling curve and box them in a binary tree."""
        if not len(mesh.faces):
            raise EngineError("there is no nearest point on a mesh without faces", code="no_faces")
        corners = mesh.vertices[mesh.faces]
        centres = corners.sum(axis=1) / 3
        self._low = centres.min(axis=0)
        self._extent = float((centres.max(axis=0) - self._low).max())
        self._order = self._along_curve(centres)
        corners = corners[self._order]
        self._corners = corners.reshape(-1, 9)
        self._boxes = _box_tree(corners)

    def nearest(self, points: FloatArray) -> tuple[SurfacePoints, FloatArray]:
        """The exact closest surface point to each of ``points`` (k, 3), and its distance (k,).

        Where several faces are equally close the one with the lowest number is named.
        """
        queries = np.ascontiguousarray(points, dtype=np.float64).reshape(-1, 3)
        face, weights, square = nearest_points(
            self._corners, self._order, self._boxes, queries, self._along_curve(queries)
        )
        return SurfacePoints(face, weights), np.sqrt(square)

    def _along_curve(self, points: FloatArray) -> IntArray:
        """Order of points along a Morton curve through the mesh's bounding cube."""
        return order_along_curve(points, self._low, self._extent)


def closest_points(mesh: Mesh, points: FloatArray) -> tuple[SurfacePoints, FloatArray]:
    """The exact closest point of ``mesh`` to each of ``points`` (k, 3), and its distance (k,).

    Raises ``EngineError`` (``no_faces``) for a mesh without faces. To ask the same mesh several
    times hold a ``PointLocator``.
    """
    return PointLocator(mesh).nearest(points)


class PlaneLocator:
    """A fold-free plane triangulation, ``z`` (n,) and ``faces`` (m, 3), in which to look often."""

    def __init__(self, z: ComplexArray, faces: IntArray) -> None:
        self._z, self._faces = z, faces
        self._locator = PointLocator(Mesh(_in_space(z), faces))
        self._rounding = 8 * np.finfo(np.float64).eps * float(np.abs(z).max())

    @cached_property
    def _opposite(self) -> IntArray:
        return opposite_halfedges(self._faces, len(self._z))

    def locate(self, queries: ComplexArray) -> tuple[SurfacePoints, FloatArray]:
        """The triangles, barycentric coordinates and distances as ``locate_in_plane``."""
        points, distance = self._locator.nearest(_in_space(queries))
        return points, np.where(distance <= self._rounding, 0.0, distance)

    def locate_near(
        self, queries: ComplexArray, near: IntArray
    ) -> tuple[SurfacePoints, FloatArray]:
        """The same, sooner where a query is a few faces away from the face ``near`` (k,) it."""
        face, weights = walked_to(
            self._z, self._faces, self._opposite, queries, near, _MOST_STEPS, _ON_A_SIDE
        )
        distance = np.zeros(len(queries))
        lost = np.flatnonzero(face < 0)
        found, distance[lost] = self.locate(queries[lost])
        face[lost], weights[lost] = found.face, found.barycentric
        return SurfacePoints(face, weights), distance


def locate_in_plane(
    z: ComplexArray, faces: IntArray, queries: ComplexArray
) -> tuple[SurfacePoints, FloatArray]:
    """The triangle and barycentric coordinates of points in a fold-free plane triangulation.

    ``z`` (n,) vertex positions, ``faces`` (m, 3), ``queries`` (k,). The distances (k,) are 0
    for points inside (to rounding in the extent of ``z``); points outside get the closest point
    of the boundary. To ask the same plane several times hold a ``PlaneLocator``.
    """
    return PlaneLocator(z, faces).locate(queries)


def _in_space(z: ComplexArray) -> FloatArray:
    return np.stack([z.real, z.imag, np.zeros(len(z))], axis=1)


def _box_tree(corners: FloatArray) -> FloatArray:
    """Boxes (lower, upper corner) of a complete binary tree over runs of faces, the root first."""
    leaves = 1 << (-(-len(corners) // LEAF) - 1).bit_length()
    count = leaves * LEAF
    level = np.full((count, 2, 3), np.inf)
    level[:, 1] = -np.inf
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    level[: len(corners), 0] = np.minimum(np.minimum(a, b), c)
    level[: len(corners), 1] = np.maximum(np.maximum(a, b), c)
    boxes = np.empty((2 * leaves - 1, 2, 3))
    while count > 1:
        count //= 2
        lower = np.minimum(level[0::2, 0], level[1::2, 0])
        upper = np.maximum(level[0::2, 1], level[1::2, 1])
        level = np.stack([lower, upper], axis=1)
        if count <= leaves:
            boxes[count - 1 : 2 * count - 1] = level
    return boxes.reshape(-1, 6)
