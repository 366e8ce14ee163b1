"""Components, boundary and Euler characteristic of any triangles, whatever is wrong with them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.topology._component_kernels import lowest_in_component
from engine.topology._halfedges import edge_runs, origins, targets
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
    runs = edge_runs(faces)
    first = runs.order[runs.start]
    edges = np.stack([origins(faces)[first], targets(faces)[first]])
    rim = edges[:, runs.size == 1]
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
    nodes = int(used.sum())
    lowest = lowest_in_component(count, edges[0], edges[1])
    return nodes, int((lowest == np.arange(count)).sum()) - (count - nodes)
