"""The sharpest loop around a cavity: the edge at which skin turns from the outside into it."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import breadth_first_order, maximum_flow
from scipy.spatial import KDTree

from engine.correspondence._spreading import Spreading
from engine.operators import face_normals, interior_edges, vertex_areas
from engine.types import BoolArray, FloatArray, IntArray, Mesh

_REACH = 0.04  # from a cavity's rim, in square roots of the area: how far off the edge may be
_WIDTH = 0.002  # half of that over which a turn is measured
_TURN = 0.1  # radians over all of it at which a turn is half sharp
_STEPS, _ENDLESS = 1e5, 10**9  # capacity of a mean edge, and of what is never cut


def sharpness(mesh: Mesh) -> FloatArray:
    """(n,) in [0, 1): how sharply the surface turns outwards at each vertex, 0 in hollows."""
    ends, pairs = interior_edges(mesh.faces)
    normals, centres = face_normals(mesh), mesh.vertices[mesh.faces].mean(axis=1)
    a, b = pairs.T
    angle = np.arccos(np.clip(np.einsum("ei,ei->e", normals[a], normals[b]), -1, 1))
    angle *= -np.sign(np.einsum("ei,ei->e", normals[a], centres[b] - centres[a]))
    bends = np.repeat(angle * _lengths(mesh, ends) / 2, 2)
    total = np.bincount(ends.ravel(), bends, len(mesh.vertices))
    spread = Spreading.over(mesh, _WIDTH)
    curvature = spread(total / np.maximum(vertex_areas(mesh), 1e-300))
    turn = np.maximum(2 * _WIDTH * curvature, 0) / _TURN
    return turn**2 / (1 + turn**2)


def up_to_ridge(mesh: Mesh, cavity: BoolArray, sharp: FloatArray) -> BoolArray:
    """``cavity`` (m,) with all between its rim and the sharpest loop around it.

    Of all loops nearby the one is taken along which the length, times how little ``sharp`` (n,)
    the surface is there, is least: a minimal cut between faces.
    """
    ends, pairs = interior_edges(mesh.faces)
    length = _lengths(mesh, ends)
    cost = length / length.mean() * (1 - sharp[ends].mean(axis=1))
    rim = ends[cavity[pairs[:, 0]] != cavity[pairs[:, 1]]]
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    far = KDTree(mesh.vertices[rim].mean(axis=1)).query(centres)[0] > _REACH
    return _least_cut(pairs, cost, cavity, far & ~cavity)


def _lengths(mesh: Mesh, ends: IntArray) -> FloatArray:
    return np.linalg.norm(np.subtract(*mesh.vertices[ends.T]), axis=1)


def _least_cut(
    pairs: IntArray, cost: FloatArray, inside: BoolArray, outside: BoolArray
) -> BoolArray:
    """(m,) what stays with ``inside`` when it is cut off ``outside`` at least ``cost`` (e,)."""
    m = len(inside)
    given, taken = np.flatnonzero(inside), np.flatnonzero(outside)
    between = np.clip(cost * _STEPS, 1, _ENDLESS / 10).astype(np.int32)
    endless = np.full(len(given) + len(taken), _ENDLESS, dtype=np.int32)
    rows = np.concatenate((pairs[:, 0], pairs[:, 1], np.full(len(given), m), taken))
    columns = np.concatenate((pairs[:, 1], pairs[:, 0], given, np.full(len(taken), m + 1)))
    data = np.concatenate((between, between, endless))
    capacity = sp.csr_array((data, (rows, columns)), shape=(m + 2, m + 2))
    left = sp.csr_array(capacity - maximum_flow(capacity, m, m + 1).flow)
    left.eliminate_zeros()
    reached = np.zeros(m + 2, dtype=np.bool_)
    reached[breadth_first_order(left, m, return_predecessors=False)] = True
    return reached[:m]
