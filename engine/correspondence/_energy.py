"""The quadratic energies of a displaced surface, over one sparsity pattern.

Unknowns are the displacements d (n, 3), vertex by vertex. Smoothness acts per coordinate, pulls
couple the coordinates of the corners of a face.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from engine.correspondence._energy_kernels import add_pulls, spread_to_corners
from engine.linalg import SymmetricPattern
from engine.nearest import vertex_stars
from engine.operators import adjacency, cotangent_weights, vertex_areas
from engine.types import FloatArray, IntArray, Mesh

_LEAST_WEIGHT, _GREATEST_WEIGHT = 0.05, 5.0
_BENT, _AROUND = 8.5, 2  # from what curvature on a displacement bends, averaged over so many rings

System = tuple[FloatArray, FloatArray]  # lower matrix data, right-hand side (n, 3)


@dataclass(frozen=True, slots=True)
class Pulls:
    """Quadratic pulls (u - g)ᵀ B (u - g) on the displacements u of points of a surface.

    The points lie in ``face`` (t,) at ``barycentric`` (t, 3); ``blocks`` B (t, 3, 3) symmetric,
    ``goals`` g (t, 3); ``fields`` (t, 3, k) are the displacement fields' values there, k may be 0.
    """

    face: IntArray
    barycentric: FloatArray
    blocks: FloatArray
    goals: FloatArray
    fields: FloatArray

    @classmethod
    def joined(cls, parts: Sequence[Pulls]) -> Pulls:
        """All pulls of ``parts``."""
        return cls(
            np.concatenate([part.face for part in parts]),
            np.concatenate([part.barycentric for part in parts]),
            np.concatenate([part.blocks for part in parts]),
            np.concatenate([part.goals for part in parts]),
            np.concatenate([part.fields for part in parts]),
        )


class DeformableSurface:
    """A surface at rest, with its operators and its analysed pattern.

    ``laplacian`` has clipped, positive weights; ``bilaplacian`` is Lᵀ M⁻¹ L with the rows of
    border vertices left out (natural boundary).
    """

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        self.n = len(mesh.vertices)
        self.areas = vertex_areas(mesh)
        self.laplacian = clipped_laplacian(mesh)
        self._cells = np.maximum(self.areas, 0.2 * np.median(self.areas))
        self._border = vertex_stars(mesh.faces, self.n).border
        self.bilaplacian = self._bilaplacian(np.ones(self.n))
        self._edges, self._face_edge = _face_edges(mesh.faces)
        self._build_pattern()

    @cached_property
    def _rings(self) -> sp.csr_array:
        """The mean (n, n) over every vertex and those beside it."""
        around = adjacency(self.mesh.faces, self.n) + sp.eye_array(self.n)
        return sp.csr_array(sp.diags_array(1 / around.sum(axis=1)) @ around)

    def _bilaplacian(self, stiffness: FloatArray) -> sp.csr_array:
        weights = np.where(self._border, 0.0, stiffness / self._cells)
        return sp.csr_array(self.laplacian.T @ sp.diags_array(weights) @ self.laplacian)

    def stiffness(self, displacement: FloatArray, most: float) -> FloatArray:
        """How many times as much (n,) bending is to cost, 1 to ``most``, after a ``displacement``.

        Most of a face moves smoothly while lips, lids and folds bend sharply: the curvature of its
        displacement (n, 3) is far from normally distributed. So its penalty is that of a
        heavy-tailed distribution, by iteratively reweighted least squares (Holland and Welsch,
        1977). Lengths are in the square root of the surface's area.
        """
        squares = np.sum((self.laplacian @ displacement) ** 2, axis=1) / self._cells**2
        for _ in range(_AROUND):
            squares = self._rings @ squares
        return np.clip(_BENT**2 / np.maximum(squares, 1e-300), 1, most)

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
        self._pattern = SymmetricPattern(indptr, entries % (3 * n))
        self._size = len(entries)
        e = len(low)
        self._between = np.ascontiguousarray(place[: 9 * e].reshape(9, e).T)
        self._diagonal = np.ascontiguousarray(place[9 * e : 9 * e + 6 * n].reshape(6, n).T)
        self._smooth = place[9 * e + 6 * n :].reshape(3, -1)
        self._smooth_rows = (smooth.row, smooth.col)

    def smoothness(
        self,
        bending: float,
        stretching: float,
        around: FloatArray,
        stiffness: FloatArray | None = None,
    ) -> System:
        """``bending`` · bilaplacian + ``stretching`` · laplacian of what differs from ``around``.

        ``around`` (n, 3) are displacements; the energy acts on each coordinate. Bending costs
        ``stiffness`` (n,) times as much.
        """
        bent = self.bilaplacian if stiffness is None else self._bilaplacian(stiffness)
        operator = sp.csr_array(bending * bent + stretching * self.laplacian)
        values = np.asarray(operator[self._smooth_rows]).ravel()
        data = np.zeros(self._size)
        for axis in range(3):
            data[self._smooth[axis]] += values
        return data, np.asarray(operator @ around)

    def add_pulls(self, system: System, pulls: Pulls) -> None:
        """Add the energy of ``pulls``."""
        pulled = np.einsum("tij,tj->ti", pulls.blocks, pulls.goals)
        add_pulls(
            system,
            (self.mesh.faces[pulls.face], pulls.barycentric),
            (pulls.blocks, pulled),
            (self._diagonal, self._between[self._face_edge[pulls.face]]),
        )

    def add_rest(self, system: System, towards: FloatArray, weights: FloatArray) -> None:
        """Pull the displacement of every vertex to ``towards`` (n, 3) by ``weights`` (n,)."""
        data, right = system
        for place in (0, 3, 5):
            data[self._diagonal[:, place]] += weights
        right += weights[:, None] * towards

    def solve(self, system: System) -> FloatArray:
        """The displacements (n, 3) that minimise the energy."""
        data, right = system
        return self._pattern.factor(data).solve(right.ravel()).reshape(-1, 3)

    def solve_with_fields(
        self, system: System, pulls: Pulls, ridge: float
    ) -> tuple[FloatArray, FloatArray]:
        """Displacements d (n, 3) and coefficients c (k,): pulls act on d plus the fields times c.

        Minimises the energy of ``system``, which holds ``pulls`` already, and ``ridge`` |c|²; the
        coefficients are found from their Schur complement.
        """
        data, right = system
        count = pulls.fields.shape[2]
        pulled = np.einsum("tij,tjk->tik", pulls.blocks, pulls.fields)
        coupling = np.zeros((self.n, 3, count))
        spread_to_corners(self.mesh.faces[pulls.face], pulls.barycentric, pulled, coupling)
        coupling = coupling.reshape(-1, count)
        fields = pulls.fields.reshape(-1, count)
        own = pulled.reshape(-1, count).T @ fields + ridge * np.eye(count)
        own_right = pulled.reshape(-1, count).T @ pulls.goals.ravel()
        both = self._pattern.factor(data).solve(np.column_stack((right.ravel(), coupling)))
        d, answer = both[:, 0], both[:, 1:]
        c = np.linalg.solve(own - coupling.T @ answer, own_right - coupling.T @ d)
        return (d - answer @ c).reshape(-1, 3), c


def clipped_laplacian(mesh: Mesh) -> sp.csr_array:
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
