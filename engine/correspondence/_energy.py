"""The quadratic energies of a deforming surface, over one sparsity pattern.

Unknowns are the positions x (n, 3), vertex by vertex. Smoothness acts per coordinate, data terms
couple the coordinates of a vertex or of the corners of a face.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from engine.correspondence._energy_kernels import add_planes, add_vertex_blocks
from engine.linalg import SymmetricPattern
from engine.nearest import Feet, Stars, vertex_stars
from engine.operators import cotangent_weights, vertex_areas
from engine.types import FloatArray, IntArray, Mesh

_LEAST_WEIGHT, _GREATEST_WEIGHT = 0.05, 5.0


System = tuple[FloatArray, FloatArray]  # lower matrix data, right-hand side (n, 3)


@dataclass(frozen=True, slots=True)
class Planes:
    """Planes through ``points`` (t, 3) with unit ``normals`` (t, 3), each with its weight."""

    points: FloatArray
    normals: FloatArray
    weights: FloatArray


class DeformableSurface:
    """A surface at rest, with its operators and its analysed pattern.

    ``laplacian`` has clipped, positive weights; ``bilaplacian`` is Lᵀ M⁻¹ L with the rows of
    border vertices left out (natural boundary).
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.n = len(mesh.vertices)
        self.areas = vertex_areas(mesh)
        self.stars: Stars = vertex_stars(mesh.faces, self.n)
        self.laplacian = _clipped_laplacian(mesh)
        self.bilaplacian = self._bilaplacian()
        self._edges, self._face_edge = _face_edges(mesh.faces)
        self._build_pattern()

    def _bilaplacian(self) -> sp.csr_array:
        areas = np.maximum(self.areas, 0.2 * np.median(self.areas))
        inner = np.where(self.stars.border, 0.0, 1 / areas)
        return sp.csr_array(self.laplacian.T @ sp.diags_array(inner) @ self.laplacian)

    def _build_pattern(self) -> None:
        n, low, high = self.n, *self._edges.T
        smooth = sp.coo_array(sp.tril(abs(self.bilaplacian) + abs(self.laplacian)))
        rows: list[IntArray] = []
        columns: list[IntArray] = []
        for column in range(3):
            for row in range(3):
                rows.append(3 * high + row)
                columns.append(3 * low + column)
        for column in range(3):
            for row in range(column, 3):
                rows.append(3 * np.arange(n) + row)
                columns.append(3 * np.arange(n) + column)
        for axis in range(3):
            rows.append(3 * smooth.row.astype(np.int64) + axis)
            columns.append(3 * smooth.col.astype(np.int64) + axis)
        keys = np.concatenate(columns) * (3 * n) + np.concatenate(rows)
        entries, place = np.unique(keys, return_inverse=True)
        counts = np.bincount(entries // (3 * n), minlength=3 * n)
        indptr = np.concatenate(([0], np.cumsum(counts))).astype(np.int64)
        self.pattern = SymmetricPattern(indptr, entries % (3 * n))
        self._size = len(entries)
        e = len(low)
        self._between = np.ascontiguousarray(place[: 9 * e].reshape(9, e).T)
        self._diagonal = np.ascontiguousarray(place[9 * e : 9 * e + 6 * n].reshape(6, n).T)
        self._smooth = place[9 * e + 6 * n :].reshape(3, -1)
        self._smooth_rows = (smooth.row, smooth.col)

    def smoothness(self, bending: float, stretching: float) -> tuple[sp.csr_array, FloatArray]:
        """The operator K = ``bending`` · bilaplacian + ``stretching`` · laplacian, and its data."""
        operator = sp.csr_array(bending * self.bilaplacian + stretching * self.laplacian)
        values = np.asarray(operator[self._smooth_rows]).ravel()
        data = np.zeros(self._size)
        for axis in range(3):
            data[self._smooth[axis]] += values
        return operator, data

    def add_at_vertices(self, data: FloatArray, blocks: FloatArray) -> None:
        """Add xᵢᵀ Bᵢ xᵢ for symmetric ``blocks`` B (n, 3, 3) to the matrix ``data``."""
        add_vertex_blocks(data, blocks, self._diagonal)

    def add_planes(self, system: System, at: Feet, planes: Planes) -> None:
        """Pull the surface's points ``at`` onto ``planes``."""
        used = np.flatnonzero(planes.weights > 0)
        root = np.sqrt(planes.weights[used])
        normals, face = planes.normals[used], at.face[used]
        add_planes(
            system,
            (self.mesh.faces[face], at.barycentric[used] * root[:, None]),
            (normals, root * np.einsum("ti,ti->t", normals, planes.points[used])),
            (self._diagonal, self._between[self._face_edge[face]]),
        )


def _clipped_laplacian(mesh: Mesh) -> sp.csr_array:
    """The cotangent Laplacian with every edge's weight clipped to moderate positive values."""
    n = len(mesh.vertices)
    edge, face_edge = _face_edges(mesh.faces)
    opposite = np.roll(cotangent_weights(mesh), -2, axis=1)  # of the edge from corner k to k+1
    weights = np.bincount(face_edge.ravel(), opposite.ravel(), len(edge))
    weights = np.clip(weights, _LEAST_WEIGHT, _GREATEST_WEIGHT)
    a, b = edge.T
    rows, columns = np.concatenate((a, b, a, b)), np.concatenate((b, a, a, b))
    values = np.concatenate((-weights, -weights, weights, weights))
    return sp.csr_array((values, (rows, columns)), shape=(n, n))


def _face_edges(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Edges (e, 2), smaller vertex first, and the edge from corner k to k+1 of each face."""
    halves = np.sort(np.stack((faces, np.roll(faces, -1, axis=1)), axis=2), axis=2).reshape(-1, 2)
    count = int(faces.max()) + 1
    keys, place = np.unique(halves[:, 0] * count + halves[:, 1], return_inverse=True)
    return np.stack((keys // count, keys % count), axis=1), place.reshape(-1, 3)
