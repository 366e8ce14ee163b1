"""Pieces of a surface laid in the plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from engine._operator_kernels import faces_within
from engine.correspondence._energy import clipped_laplacian
from engine.linalg import FixedSolver
from engine.locate import locate_in_plane
from engine.operators import adjacency, edges, interior_edges
from engine.topology import boundary_loops
from engine.types import BoolArray, ComplexArray, FloatArray, IntArray, Mesh, SurfacePoints


@dataclass(frozen=True, slots=True)
class Chart:
    """A piece of a surface on the unit disk: its ``faces`` there, ``corners`` into ``z``."""

    faces: IntArray
    corners: IntArray
    z: ComplexArray

    @classmethod
    def around(cls, mesh: Mesh, faces: IntArray, links: sp.csr_array, rings: int) -> Chart | None:
        """The disk around most of ``faces``, perhaps with convex holes; None if there is none.

        What they surround belongs to it, but for the surface's own holes. Its rim goes to the
        circle by arc length, the rest by positive weights (Tutte 1963). Faces that are not
        connected with it within so many ``rings`` are left out, or only by a vertex if it is no
        disk with them.
        """
        near = np.zeros(len(mesh.vertices), dtype=np.bool_)
        near[mesh.faces[faces]] = True
        near = dilated(near, links, rings)
        part = parts(near, links)
        near = part == np.bincount(part[mesh.faces[faces, 0]]).argmax()
        chosen = np.flatnonzero(faces_within(near, mesh.faces))
        if len(_piece(mesh, chosen)[2]) > 1:
            chosen = np.flatnonzero(faces_within(_filled(near, links), mesh.faces))
        return cls._of(mesh, chosen) or cls._of(mesh, _joined(mesh, chosen, faces))

    @classmethod
    def _of(cls, mesh: Mesh, chosen: IntArray) -> Chart | None:
        """The chart of the ``chosen`` faces; None if they are no disk, perhaps with holes."""
        vertices, corners, rims = _piece(mesh, chosen)
        euler = len(vertices) - len(edges(corners)) + len(corners)
        if not rims or euler != 2 - len(rims) or not _connected(corners, len(vertices)):
            return None
        patch = Mesh(mesh.vertices[vertices], corners)
        lengths = [_along(patch, rim) for rim in rims]
        outer = int(np.argmax([along[-1] for along in lengths]))
        circle = np.exp(2j * np.pi * lengths[outer] / lengths[outer][-1])
        z = FixedSolver(clipped_laplacian(patch), rims[outer]).solve(circle)
        return cls(chosen, corners, z)

    def of(self, points: SurfacePoints) -> ComplexArray:
        """Where ``points`` (k,) of the surface lie, NaN for those outside of this piece."""
        place = np.minimum(np.searchsorted(self.faces, points.face), len(self.faces) - 1)
        z: ComplexArray = np.einsum("ki,ki->k", points.barycentric, self.z[self.corners[place]])
        return np.where(self.faces[place] == points.face, z, np.nan)

    def located(self, z: ComplexArray) -> SurfacePoints:
        """The points (k,) of the surface at ``z`` (k,)."""
        found = locate_in_plane(self.z, self.corners, z)[0]
        return SurfacePoints(self.faces[found.face], found.barycentric)


def dilated(chosen: BoolArray, links: sp.csr_array, rings: int) -> BoolArray:
    """``chosen`` (n,) vertices and those at most ``rings`` of ``links`` away."""
    near, rim = chosen.copy(), np.flatnonzero(chosen)
    for _ in range(rings):
        around = links[rim].indices
        rim = np.unique(around[~near[around]])
        near[rim] = True
    return near


def parts(chosen: BoolArray, links: sp.csr_array) -> IntArray:
    """(n,) which connected part of the ``chosen`` (n,) vertices each is in; -1 for the others."""
    vertices = np.flatnonzero(chosen)
    part = np.full(len(chosen), -1)
    part[vertices] = connected_components(links[vertices][:, vertices], directed=False)[1]
    return part


def _joined(mesh: Mesh, chosen: IntArray, wanted: IntArray) -> IntArray:
    """Those of the ``chosen`` faces that edges join to most of those that are ``wanted`` too."""
    first, second = interior_edges(mesh.faces[chosen])[1].T
    beside = sp.coo_array((np.ones(len(first)), (first, second)), shape=(len(chosen), len(chosen)))
    sheet = connected_components(beside, directed=False)[1]
    return chosen[sheet == np.bincount(sheet[np.isin(chosen, wanted)]).argmax()]


def _piece(mesh: Mesh, faces: IntArray) -> tuple[IntArray, IntArray, tuple[IntArray, ...]]:
    """The vertices of ``faces``, these over them, and the loops around them."""
    vertices, flat = np.unique(mesh.faces[faces], return_inverse=True)
    corners = flat.reshape(-1, 3)
    return vertices, corners, boundary_loops(corners, len(vertices))


def _filled(near: BoolArray, links: sp.csr_array) -> BoolArray:
    """``near`` (n,) vertices and the parts of the others next to them but the largest one."""
    part = parts(~near, links)
    beside = np.unique(part[dilated(near, links, 1) & ~near])
    if len(beside) == 0:
        return near
    outside = beside[np.bincount(part[~near])[beside].argmax()]
    return near | np.isin(part, beside[beside != outside])


def _connected(faces: IntArray, vertex_count: int) -> bool:
    return connected_components(adjacency(faces, vertex_count), directed=False)[0] == 1


def _along(mesh: Mesh, loop: IntArray) -> FloatArray:
    """The length of ``loop`` (k,) up to the end of each of its edges."""
    steps = mesh.vertices[np.roll(loop, -1)] - mesh.vertices[loop]
    return np.cumsum(np.linalg.norm(steps, axis=1))
