"""The source as an elastic skin: bending and stretching energies, and local rotations.

For positions x over the rest shape v, with rotations (times scales) T_i per vertex,

    bending     sum_i |(L x)_i - T_i (L v)_i|^2 / A_i
    stretching  1/2 sum_ij w_ij |x_i - x_j - (T_i + T_j)/2 (v_i - v_j)|^2

are quadratic in x; they are minimised in turn over x and over T (Sorkine and Alexa,
"As-rigid-as-possible surface modeling", 2007). L v are the details that T turns.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
import scipy.sparse as sp

from engine.errors import RestorationError
from engine.linalg import Factor, SymmetricPattern
from engine.operators import (
    adjacency,
    cotangent_laplacian,
    edges,
    interior_edges,
    vertex_areas,
    vertex_normals,
)
from engine.restoration._rotation_kernels import edge_covariances, nearest_rotations, turned_edges
from engine.types import FloatArray, Mesh

_RING_WEIGHTS = (0.02, 10.0)  # positive, so that rotations stay well defined on obtuse faces
_BEND_WEIGHTS = (-1.0, 10.0)  # as the cotangents are, but for slivers
_SCALES = (0.5, 2.0)  # local scales beyond these are stretch, not size
_SMALLEST_AREA = 0.2  # of the median vertex area: a speck must not stiffen its surroundings
_ROTATION_WINDOW = 0.015  # of the diagonal: a rotation is a neighbourhood's, not a triangle's


def diagonal(vertices: FloatArray) -> float:
    """Length of the bounding box's diagonal."""
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def _clipped_laplacian(weights: sp.csr_array, least: float, most: float) -> sp.csr_array:
    clipped = weights.copy()
    clipped.data = np.clip(clipped.data, least, most)
    return cast(sp.csr_array, sp.diags_array(clipped.sum(axis=1)) - clipped)


class Elastic:
    """Energies of one mesh in one sparsity pattern, analysed once."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        n = len(mesh.vertices)
        self.size = diagonal(mesh.vertices)
        self.areas: FloatArray = vertex_areas(mesh)
        if not (self.size > 0 and self.areas.sum() > 0):
            raise RestorationError("a surface without area cannot be restored", code="no_area")
        self._build_rings(mesh, n)
        self._build_energies(mesh, n)

    def _build_rings(self, mesh: Mesh, n: int) -> None:
        laplacian = cotangent_laplacian(mesh)
        self._weights = cast(sp.csr_array, sp.diags_array(laplacian.diagonal()) - laplacian)
        self._weights = cast(Any, self._weights).multiply(adjacency(mesh.faces, n)).tocsr()
        self._weights = cast(sp.csr_array, self._weights + 1e-300 * adjacency(mesh.faces, n))
        self._weights.sort_indices()
        self._start = self._weights.indptr.astype(np.int64)
        self._neighbour = self._weights.indices.astype(np.int64)
        self._ring = np.clip(self._weights.data, *_RING_WEIGHTS)
        ends = edges(mesh.faces)
        spacing = float(
            np.linalg.norm(mesh.vertices[ends[:, 0]] - mesh.vertices[ends[:, 1]], axis=1).mean()
        )
        self._rounds = int(np.clip(round(_ROTATION_WINDOW * self.size / spacing), 1, 8))
        self._gather = cast(sp.csr_array, adjacency(mesh.faces, n) + sp.eye_array(n))

    def _build_energies(self, mesh: Mesh, n: int) -> None:
        ends = edges(mesh.faces)
        inner, _ = interior_edges(mesh.faces)
        free = np.setdiff1d(ends @ [n, 1], inner @ [n, 1])
        interior = np.ones(n)
        interior[np.concatenate([free // n, free % n])] = 0.0  # the natural boundary
        floor = _SMALLEST_AREA * np.median(self.areas)
        root = interior / np.sqrt(np.maximum(self.areas, floor))
        bender = _clipped_laplacian(self._weights, *_BEND_WEIGHTS)
        self._bender = cast(sp.csr_array, sp.diags_array(root) @ bender)
        bending = self._bender.T @ self._bender
        stretching = _clipped_laplacian(self._weights, *_RING_WEIGHTS)
        self.pattern, everything = SymmetricPattern.of(
            abs(bending) + abs(stretching) + 1e-300 * abs(bender) @ abs(bender) + sp.eye_array(n)
        )
        self._bending = self._on_pattern(bending, len(everything))
        self._stretching = self._on_pattern(stretching, len(everything))

    def _on_pattern(self, matrix: sp.sparray, count: int) -> FloatArray:
        lower = cast(Any, sp.tril(matrix, format="coo"))
        n = self.pattern.n
        columns = np.repeat(np.arange(n), np.diff(self.pattern.indptr))
        keys = columns * n + self.pattern.indices
        data = np.zeros(count)
        data[np.searchsorted(keys, lower.col.astype(np.int64) * n + lower.row)] = lower.data
        return data

    def factor(self, *, bend: float, stretch: float, hold: FloatArray) -> Factor:
        """Factor of bend * bending + stretch * stretching + diag(``hold`` (n,))."""
        data = bend * self._bending + stretch * self._stretching
        data[self.pattern.diagonal] += hold
        return self.pattern.factor(data)

    def load(
        self, rest: FloatArray, turns: FloatArray, *, bend: float, stretch: float
    ) -> FloatArray:
        """Right side (n, 3) of the same energies for the shape ``rest`` turned by (n, 3, 3)."""
        details = np.einsum("nij,nj->ni", turns, self._bender @ rest)
        pulled = turned_edges(rest, turns, self._start, self._neighbour, self._ring)
        return bend * (self._bender.T @ details) + stretch * pulled

    def turns(self, rest: FloatArray, after: FloatArray, scale: float | None = None) -> FloatArray:
        """Local rotations (n, 3, 3) from ``rest`` to ``after``.

        With the overall ``scale`` between the two, they carry local scales around it too.
        """
        covariance, energy = edge_covariances(rest, after, self._start, self._neighbour, self._ring)
        flat = covariance.reshape(-1, 9)
        for _ in range(self._rounds):
            flat = self._gather @ flat
            energy = self._gather @ energy
        covariance = np.ascontiguousarray(flat).reshape(-1, 3, 3)
        normals = vertex_normals(self.mesh.moved(rest)), vertex_normals(self.mesh.moved(after))
        upright = np.einsum("n,ni,nj->nij", energy, normals[1], normals[0])
        rotations = nearest_rotations(covariance + upright)
        if scale is not None:
            size = np.einsum("nij,nij->n", rotations, covariance) / scale
            local = np.divide(size, energy, out=np.ones_like(size), where=energy > 0)
            rotations *= scale * np.clip(local, *_SCALES)[:, None, None]
        return rotations
