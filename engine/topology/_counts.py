"""Components, boundary and Euler characteristic of any triangles, whatever is wrong with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components

from engine.topology._halfedges import origins, pair_keys, targets
from engine.topology._welding import face_kinds, position_classes
from engine.topology._welding_kernels import PROPER
from engine.types import BoolArray, IntArray, Mesh


@dataclass(frozen=True, slots=True)
class TopologyCounts:
    """``boundary_loops`` counts independent cycles of edges with one face, however it is wound."""

    components: int
    boundary_loops: int
    euler_characteristic: int


def used_vertices(mesh: Mesh) -> BoolArray:
    """(n,) whether each vertex has a face."""
    used = np.zeros(len(mesh.vertices), np.bool_)
    used[mesh.faces] = True
    return used


def topology_counts(mesh: Mesh) -> TopologyCounts:
    """The counts of ``mesh`` once vertices at one place are one.

    Seams and triangle soup hang together; faces with two corners at one place do not count, nor
    do faces that repeat others.
    """
    position = position_classes(mesh.vertices)
    faces = position[mesh.faces[face_kinds(mesh.faces, position)[0] == PROPER]]
    keys = np.sort(pair_keys(origins(faces), targets(faces)))
    first = np.flatnonzero(np.diff(keys, prepend=-1))
    edges = np.stack(np.divmod(keys[first], np.int64(faces.max(initial=0)) + 1))
    rim = edges[:, np.diff(first, append=len(keys)) == 1]
    used, parts = _graph(edges, len(mesh.vertices))
    rim_used, rim_parts = _graph(rim, len(mesh.vertices))
    return TopologyCounts(
        components=parts,
        boundary_loops=rim.shape[1] - rim_used + rim_parts,
        euler_characteristic=used - edges.shape[1] + len(faces),
    )


def _graph(edges: IntArray, count: int) -> tuple[int, int]:
    """Nodes and connected parts of the graph with these edges (2, k), without lone nodes."""
    used = np.zeros(count, np.bool_)
    used[edges] = True
    links = sparse.coo_array((np.ones(edges.shape[1], np.int8), tuple(edges)), shape=(count, count))
    nodes = int(used.sum())
    return nodes, int(connected_components(links, directed=False)[0]) - (count - nodes)
