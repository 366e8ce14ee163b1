"""Discrete operators on triangle meshes: areas, normals, adjacency, the cotangent Laplacian."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from engine._edge_kernels import edges_and_uses, faces_at_edges
from engine._operator_kernels import (
    doubled_normals,
    lengths,
    normalise,
    one_rings,
    ring_sums,
    sums_at_vertices,
)
from engine.halfedges import edge_keys
from engine.types import BoolArray, FloatArray, IntArray, Mesh


def face_areas(mesh: Mesh) -> FloatArray:
    """Areas (m,)."""
    return 0.5 * lengths(doubled_normals(mesh.vertices, mesh.faces))


def face_normals(mesh: Mesh) -> FloatArray:
    """Unit normals (m, 3) on the side from which faces are counter-clockwise; 0 where area is 0."""
    normals = doubled_normals(mesh.vertices, mesh.faces)
    normalise(normals)
    return normals


def vertex_areas(mesh: Mesh) -> FloatArray:
    """Barycentric areas (n,): a third of every face at a vertex."""
    thirds = face_areas(mesh)[:, None] / 3
    return sums_at_vertices(mesh.faces, thirds, len(mesh.vertices))[:, 0]


def vertex_normals(mesh: Mesh) -> FloatArray:
    """Unit area-weighted normals (n, 3); 0 at vertices without area."""
    doubled = doubled_normals(mesh.vertices, mesh.faces)
    normals = sums_at_vertices(mesh.faces, doubled, len(mesh.vertices))
    normalise(normals)
    return normals


def unit_vectors(vectors: FloatArray) -> FloatArray:
    """``vectors`` (..., 3) at length 1; those without a length stay 0."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)


def edges(faces: IntArray) -> IntArray:
    """The undirected edges (e, 2) of ``faces``, each once, smaller vertex first, sorted."""
    return edges_and_uses(*edge_keys(faces))[0]


def interior_edges(faces: IntArray) -> tuple[IntArray, IntArray]:
    """Edges with two faces: vertices (k, 2), smaller first, sorted, and the two faces (k, 2)."""
    return faces_at_edges(*edge_keys(faces))


@dataclass(frozen=True, slots=True)
class Rings:
    """Who shares an edge: the neighbours of vertex i are ``neighbour[start[i] : start[i + 1]]``."""

    start: IntArray
    neighbour: IntArray

    @classmethod
    def of(cls, faces: IntArray, vertex_count: int) -> Rings:
        """The rings of ``faces`` (m, 3), neighbours ascending."""
        return cls(*one_rings(faces, vertex_count))

    def sums(self, values: FloatArray, rounds: int = 1) -> FloatArray:
        """The sum (n, c) of ``values`` (n, c) over each vertex and its neighbours, repeatedly."""
        room = np.empty_like(values), np.empty_like(values)
        for done in range(rounds):
            ring_sums(values, self.start, self.neighbour, room[done % 2])
            values = room[done % 2]
        return values

    def grown(self, marked: BoolArray, rings: int) -> BoolArray:
        """``marked`` (n,) and everything within some ``rings`` of it."""
        near = marked.astype(np.float64)[:, None]
        for _ in range(rings):
            near = (self.sums(near) > 0).astype(np.float64)
        return near[:, 0] > 0


def adjacency(faces: IntArray, vertex_count: int) -> sp.csr_array:
    """The symmetric 0/1 matrix (n, n) of vertices that share an edge."""
    start, neighbour = one_rings(faces, vertex_count)
    shape = (vertex_count, vertex_count)
    return sp.csr_array((np.ones(len(neighbour)), neighbour, start), shape=shape)


def cotangent_weights(mesh: Mesh, *, minimum_sine: float = 1e-8) -> FloatArray:
    """Half cotangents (m, 3) of the angle at each corner, i.e. of the edge opposite to it.

    A face is treated as if its doubled area were at least ``minimum_sine`` times its longest
    edge squared, so that slivers stay finite; a face of coincident vertices weighs nothing.
    """
    corner = mesh.vertices[mesh.faces]
    ahead = np.roll(corner, -1, axis=1) - corner
    back = np.roll(corner, 1, axis=1) - corner
    longest = np.einsum("mij,mij->mi", ahead, ahead).max(axis=1)
    doubled = lengths(doubled_normals(mesh.vertices, mesh.faces))
    doubled = np.maximum(doubled, minimum_sine * longest)[:, None]
    dots = np.einsum("mij,mij->mi", ahead, back)
    return np.divide(dots, 2 * doubled, out=np.zeros_like(dots), where=doubled > 0)


def cotangent_laplacian(mesh: Mesh, *, minimum_sine: float = 1e-8) -> sp.csr_array:
    """L (n, n), positive semi-definite: xᵀLx is the Dirichlet energy of the linear function x.

    Rows sum to 0; the weight of edge ij is half the sum of the cotangents opposite to it.
    ``minimum_sine`` as in ``cotangent_weights``.
    """
    weights = cotangent_weights(mesh, minimum_sine=minimum_sine)
    return weighted_laplacian(mesh.faces, weights, len(mesh.vertices))


def weighted_laplacian(faces: IntArray, weights: FloatArray, vertex_count: int) -> sp.csr_array:
    """L (n, n) with xᵀLx = Σ w_ij (x_i - x_j)²; ``weights`` (m, 3) at corners add to the edge
    opposite to each."""
    w = weights.ravel()
    a, b = faces[:, [1, 2, 0]].ravel(), faces[:, [2, 0, 1]].ravel()
    rows = np.concatenate([a, b, a, b])
    columns = np.concatenate([b, a, a, b])
    values = np.concatenate([-w, -w, w, w])
    return sp.csr_array((values, (rows, columns)), shape=(vertex_count, vertex_count))
