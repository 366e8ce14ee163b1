"""The source as an elastic skin: bending and stretching energies, and local rotations.

For positions x over the rest shape v, with rotations (times scales) T_i per vertex,

    bending     sum_i |(L x)_i - T_i (L v)_i|^2 / A_i
    stretching  1/2 sum_ij w_ij |x_i - x_j - (T_i + T_j)/2 (v_i - v_j)|^2

are quadratic in x; they are minimised in turn over x and over T (Sorkine and Alexa,
"As-rigid-as-possible surface modeling", 2007). L v are the details that T turns.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np
import scipy.sparse as sp

from engine.errors import RestorationError
from engine.linalg import Factor, SymmetricPattern
from engine.operators import (
    Rings,
    cotangent_laplacian,
    edges,
    interior_edges,
    vertex_areas,
    vertex_normals,
)
from engine.restoration._rotation_kernels import (
    edge_covariances,
    edge_energies,
    turned_edges,
    upright_rotations,
)
from engine.restoration._turned import Orientation
from engine.types import BoolArray, FloatArray, Mesh

_RING_WEIGHTS = (0.02, 10.0)  # positive, so that rotations stay well defined on obtuse faces
_BEND_WEIGHTS = (-1.0, 10.0)  # as the cotangents are, but for slivers
_RIM_STRETCH = 15.0  # rim edges, which no bending row holds, resist turning over by themselves
_SCALES = (0.5, 2.0)  # local scales beyond these are stretch, not size
_SMALLEST_AREA = 0.2  # of the median vertex area: a speck must not stiffen its surroundings
_LEAST_AREA = 1e-6  # of the mean vertex area, so that vertices without faces have a place too
_ROTATION_WINDOW = 0.015  # of the diagonal: a rotation is a neighbourhood's, not a triangle's


def diagonal(vertices: FloatArray) -> float:
    """Length of the bounding box's diagonal."""
    return float(np.linalg.norm(np.ptp(vertices, axis=0)))


def positive_areas(mesh: Mesh) -> FloatArray:
    """Vertex areas (n,), a little more than 0 where there is none; some area is needed."""
    areas = vertex_areas(mesh)
    if not areas.any():
        raise RestorationError("a surface without area cannot be restored", code="no_area")
    return np.maximum(areas, _LEAST_AREA * areas.mean())


def _laplacian(weights: sp.csr_array) -> sp.csr_array:
    return cast(sp.csr_array, sp.diags_array(weights.sum(axis=1)) - weights)


def _inside(mesh: Mesh) -> BoolArray:
    """Which vertices (n,) are on no boundary edge."""
    n = len(mesh.vertices)
    inner, _ = interior_edges(mesh.faces)
    rim = np.setdiff1d(edges(mesh.faces) @ [n, 1], inner @ [n, 1])
    inside = np.ones(n, dtype=np.bool_)
    inside[np.concatenate([rim // n, rim % n])] = False
    return inside


@dataclass(frozen=True, slots=True)
class Rest:
    """A shape, and what turning it takes."""

    vertices: FloatArray  # (n, 3)
    details: FloatArray  # (n, 3) what bending keeps, but for its direction
    normals: FloatArray  # (n, 3)
    energy: FloatArray  # (n,) of the edges around each vertex


class Elastic:
    """Energies of one mesh in one sparsity pattern, analysed once."""

    def __init__(self, mesh: Mesh) -> None:
        self.mesh = mesh
        n = len(mesh.vertices)
        self.size = diagonal(mesh.vertices)
        self.areas: FloatArray = positive_areas(mesh)
        self._interior = _inside(mesh)  # at the rim, no bending row: the natural boundary
        self._build_energies(self._build_rings(mesh, n), n)

    @cached_property
    def orientation(self) -> Orientation:
        """Which side of the mesh's faces is up."""
        return Orientation(self.mesh, self.rings)

    def _build_rings(self, mesh: Mesh, n: int) -> sp.csr_array:
        """The one-rings in compressed rows; returns the cotangent weights in their pattern."""
        self.rings = Rings.of(mesh.faces, n)
        start, neighbour = self.rings.start, self.rings.neighbour
        rows = np.repeat(np.arange(n), np.diff(start))
        data = -np.asarray(cast(Any, cotangent_laplacian(mesh))[rows, neighbour])
        weights = sp.csr_array((data, neighbour, start), shape=(n, n))
        rim = ~self._interior[rows] | ~self._interior[neighbour]
        self._ring: FloatArray = np.clip(data, *_RING_WEIGHTS) * np.where(rim, _RIM_STRETCH, 1.0)
        steps = mesh.vertices[rows] - mesh.vertices[neighbour]
        spacing = float(np.linalg.norm(steps, axis=1).mean())
        self._rounds = int(np.clip(round(_ROTATION_WINDOW * self.size / spacing), 1, 8))
        return weights

    def _build_energies(self, weights: sp.csr_array, n: int) -> None:
        floor = _SMALLEST_AREA * np.median(self.areas)
        root = self._interior / np.sqrt(np.maximum(self.areas, floor))
        bend = weights.copy()
        bend.data = np.clip(weights.data, *_BEND_WEIGHTS)
        self._bender = cast(sp.csr_array, sp.diags_array(root) @ _laplacian(bend))
        stretch = weights.copy()
        stretch.data = self._ring
        near = weights.copy()
        near.data = np.ones(len(weights.data))
        near = cast(sp.csr_array, near + sp.eye_array(n))
        self.pattern, entries = SymmetricPattern.of(near @ near)
        self._bending = self._on_pattern(self._bender.T @ self._bender, len(entries))
        self._stretching = self._on_pattern(_laplacian(stretch), len(entries))

    def _on_pattern(self, matrix: sp.sparray, count: int) -> FloatArray:
        lower = cast(Any, sp.tril(matrix, format="coo"))
        n = self.pattern.n
        columns = np.repeat(np.arange(n), np.diff(self.pattern.indptr))
        keys = columns * n + self.pattern.indices
        data = np.zeros(count)
        data[np.searchsorted(keys, lower.col.astype(np.int64) * n + lower.row)] = lower.data
        return data

    def factor(self, *, bend: float, stretch: float, hold: FloatArray) -> Factor:
        """Factor of ``stiffness``."""
        return self.pattern.factor(self.stiffness(bend=bend, stretch=stretch, hold=hold))

    def stiffness(self, *, bend: float, stretch: float, hold: FloatArray) -> FloatArray:
        """Lower values of bend * bending + stretch * stretching + diag(``hold`` (n,))."""
        data = bend * self._bending + stretch * self._stretching
        data[self.pattern.diagonal] += hold
        return data

    @cached_property
    def rest(self) -> Rest:
        """The mesh itself, to be turned."""
        return self.rest_of(self.mesh.vertices)

    def rest_of(self, vertices: FloatArray) -> Rest:
        """The shape ``vertices`` (n, 3), to be turned."""
        rings, mesh = self.rings, self.mesh.moved(vertices)
        energy = edge_energies(vertices, rings.start, rings.neighbour, self._ring)
        smooth = rings.sums(energy[:, None], self._rounds)[:, 0]
        return Rest(vertices, self._bender @ vertices, vertex_normals(mesh), smooth)

    def load(
        self,
        rest: Rest,
        after: FloatArray,
        scale: float | None = None,
        *,
        bend: float,
        stretch: float,
    ) -> FloatArray:
        """Right side (n, 3) of the same energies for ``rest``, turned as it is in ``after`` (n, 3).

        With the overall ``scale`` between the two, local scales around it are kept too.
        """
        turns, rings = self._turns(rest, after, scale), self.rings
        details = np.einsum("nij,nj->ni", turns, rest.details)
        pulled = turned_edges(rest.vertices, turns, rings.start, rings.neighbour, self._ring)
        return bend * (self._bender.T @ details) + stretch * pulled

    def _turns(self, rest: Rest, after: FloatArray, scale: float | None) -> FloatArray:
        """Local rotations (n, 3, 3) from ``rest`` to ``after``, and scales around ``scale``."""
        rings, energy = self.rings, rest.energy
        sums = edge_covariances(rest.vertices, after, rings.start, rings.neighbour, self._ring)
        covariance = rings.sums(sums, self._rounds).reshape(-1, 3, 3)
        normals = vertex_normals(self.mesh.moved(after))
        rotations, size = upright_rotations(covariance, energy, rest.normals, normals)
        if scale is not None:
            local = np.divide(size / scale, energy, out=np.ones_like(size), where=energy > 0)
            rotations *= scale * np.clip(local, *_SCALES)[:, None, None]
        return rotations
