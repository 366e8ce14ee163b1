"""Skin that faces skin across little air: lips and lids, which must not pass through each other.

Pairs of vertices that face each other, near in space but not along the surface, keep the gap that
they had, or a little clearance. What is missing is a displacement d of the surface that minimises

    K sum_pairs |d_i - d_j - p n|^2 + |grad d|^2 + (bend * Laplacian d)^2 + |d|^2 / (length m)^2,

p n the missing gap along the common normal and m the share of the largest motion that a vertex has:
what moves makes way for what is still. One matrix serves all weights, so that d changes as p does.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, cast

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from engine.linalg import SymmetricPattern
from engine.operators import (
    cotangent_weights,
    edges,
    unit_vectors,
    vertex_normals,
    weighted_laplacian,
)
from engine.restoration._elastic import diagonal, positive_areas
from engine.types import FloatArray, IntArray, Mesh

_NEAR = 0.01  # of the diagonal: farther apart, nothing touches
_NEAR_EDGES = 3.0  # median edges: on dense meshes nearer suffices
_CROWD = 100  # vertices within that distance, on average: more is where a mesh is far denser
_AROUND = 5.0  # times that, the shortest way along the surface between what faces each other
_OPPOSED = -0.3  # cosine between normals
_BEHIND = 0.3  # of what is near: deeper in one another, skin does not face
_FIRM = 10.0  # K, of a pair against the gradient
_BEND = 0.015  # of the diagonal: a displacement has no finer details
_WEIGHTS = (0.01, 5.0)  # of corners, so that slivers bend like other faces
_SMALLEST_AREA = 0.2  # of the median vertex area, likewise
_LENGTH = 0.1  # of the diagonal: how far it spreads in what moves most
_STILL = 0.1  # of the largest motion, what still skin counts as
_SMOOTHED = 3  # of normals along what touches
_CLEARANCE = 0.003  # of the diagonal: gaps above it may close down to it
_ROUNDS = 4  # of pushing apart what is left
_SOURCES = 64  # of shortest ways at a time


class Contacts:
    """What faces each other on a mesh or on any of its ``shapes`` (n, 3).

    ``moves`` (n,): how far each vertex goes in the shapes.
    """

    def __init__(self, mesh: Mesh, shapes: Sequence[FloatArray], moves: FloatArray) -> None:
        self._mesh = mesh
        found = [facing(mesh.moved(shape)) for shape in (mesh.vertices, *shapes)]
        self.pairs = np.unique(np.concatenate(found), axis=0)
        if len(self.pairs):
            self._prepare(moves)

    def _prepare(self, moves: FloatArray) -> None:
        mesh, n = self._mesh, len(self._mesh.vertices)
        size, areas = diagonal(mesh.vertices), positive_areas(mesh)
        self._clearance = _CLEARANCE * size
        rows = np.tile(np.arange(len(self.pairs)), 2)
        signs = np.repeat([1.0, -1.0], len(self.pairs))
        across = sp.csr_array((signs, (rows, self.pairs.T.ravel())), shape=(len(self.pairs), n))
        self._partners = np.maximum(np.bincount(self.pairs.ravel(), minlength=n), 1)
        self._firm = _FIRM / np.sqrt(self._partners[self.pairs].prod(axis=1))
        self._across, self._joining = across, cast(sp.csr_array, across.T.tocsr())
        share = moves / max(float(moves.max()), np.finfo(np.float64).tiny)
        hold = areas / np.square(_LENGTH * size * (share + _STILL))
        angles = np.clip(cotangent_weights(mesh), *_WEIGHTS)
        smooth = weighted_laplacian(mesh.faces, angles, n)
        inverse = sp.diags_array(1.0 / np.maximum(areas, _SMALLEST_AREA * np.median(areas)))
        bent = (_BEND * size) ** 2 * (smooth @ inverse @ smooth)
        touching = self._joining @ sp.diags_array(self._firm) @ across
        matrix = cast(sp.csr_array, smooth + bent + touching + sp.diags_array(hold))
        pattern, data = SymmetricPattern.of(matrix)
        self._factor = pattern.factor(data)

    def parted(self, shape: FloatArray, within: FloatArray) -> FloatArray:
        """``shape`` (n, 3) with gaps that ``within`` (n, 3) has, or with the clearance."""
        if not len(self.pairs):
            return shape
        normals = self._normals(within)
        least = np.minimum(self._gaps(within, normals), self._clearance)
        push = np.maximum(least - self._gaps(shape, normals), 0.0)
        parted = shape
        for _ in range(_ROUNDS):
            if not push.any():
                break
            apart = self._joining @ ((self._firm * push)[:, None] * normals)
            parted = shape + self._factor.solve(apart)
            push = np.maximum(push + least - self._gaps(parted, normals), 0.0)
        return parted

    def depths(self, shape: FloatArray, within: FloatArray) -> FloatArray:
        """How deep in one another the pairs (p,) are, beyond what ``within`` (n, 3) has of it."""
        if not len(self.pairs):
            return np.zeros(0)
        normals = self._normals(within)
        least = np.minimum(self._gaps(within, normals), 0.0)
        return np.maximum(least - self._gaps(shape, normals), 0.0)

    def _gaps(self, x: FloatArray, normals: FloatArray) -> FloatArray:
        return np.einsum("pa,pa->p", self._across @ x, normals)

    def _normals(self, x: FloatArray) -> FloatArray:
        """The pairs' common normals (p, 3), from the second's side to the first's, smoothed."""
        normals = unit_vectors(-self._across @ vertex_normals(self._mesh.moved(x)))
        for _ in range(_SMOOTHED):
            each = (self._joining @ normals) / self._partners[:, None]
            normals = unit_vectors(self._across @ each)
        return normals


def facing(mesh: Mesh) -> IntArray:
    """Pairs (p, 2), the lower index first, of vertices that face each other across little air."""
    x, normals = mesh.vertices, vertex_normals(mesh)
    ends = edges(mesh.faces)
    lengths = np.linalg.norm(x[ends[:, 0]] - x[ends[:, 1]], axis=1)
    near = min(_NEAR * diagonal(x), _NEAR_EDGES * float(np.median(lengths)))
    tree = KDTree(x)
    while tree.count_neighbors(tree, near) > _CROWD * len(x):
        near *= 0.5
    pairs = np.asarray(tree.query_pairs(near, output_type="ndarray"), dtype=np.int64)
    pairs = np.sort(pairs.reshape(-1, 2), axis=1)
    first, second = normals[pairs[:, 0]], normals[pairs[:, 1]]
    way = x[pairs[:, 1]] - x[pairs[:, 0]]
    ahead = np.minimum((first * way).sum(axis=1), -(second * way).sum(axis=1))
    pairs = pairs[((first * second).sum(axis=1) < _OPPOSED) & (ahead > -_BEHIND * near)]
    graph = sp.csr_array((lengths, (ends[:, 0], ends[:, 1])), shape=(len(x), len(x)))
    return pairs[_apart(graph, pairs, _AROUND * near)]


def _apart(graph: sp.csr_array, pairs: IntArray, limit: float) -> IntArray:
    """Which pairs are farther apart than ``limit`` along the edges of ``graph``."""
    order = np.argsort(pairs[:, 0], kind="stable")
    sources, begin = np.unique(pairs[order, 0], return_index=True)
    bounds = np.append(begin, len(pairs))
    far: list[IntArray] = [np.empty(0, dtype=np.int64)]
    for start in range(0, len(sources), _SOURCES):
        stop = min(start + _SOURCES, len(sources))
        here = order[bounds[start] : bounds[stop]]
        ways: Any = dijkstra(graph, directed=False, indices=sources[start:stop], limit=limit)
        row = np.searchsorted(sources[start:stop], pairs[here, 0])
        far.append(here[~np.isfinite(ways[row, pairs[here, 1]])])
    return np.concatenate(far)
