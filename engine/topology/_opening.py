"""Opening a closed surface where it matters least."""

from __future__ import annotations

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import dijkstra

from engine.topology._halfedges import origins, targets, twins
from engine.topology._opening_kernels import grown_disk
from engine.topology._sheets import face_vectors
from engine.types import BoolArray, FloatArray, IntArray, Mesh

OPENED_SHARE = 0.05
"""Share of the area of a closed surface that is taken out to flatten the rest."""

CANDIDATES = 12


def opening_patch(mesh: Mesh, keep: IntArray | None) -> BoolArray:
    """Faces (m,) of a disk-shaped patch of a closed mesh to take out.

    With ``keep`` (vertices) it lies around the vertex farthest from them along the edges, and
    none of them is inside. Without, around the least detailed of a dozen spread vertices: where
    the patch bends least (sum of edge length times angle between the normals).
    """
    graph = _edge_graph(mesh)
    if keep is not None and len(keep):
        away = dijkstra(graph, indices=np.unique(keep), min_only=True)
        return _patch(mesh, graph, int(np.argmax(away)), keep)
    none = np.empty(0, dtype=np.int64)
    patches = [_patch(mesh, graph, centre, none) for centre in _spread_vertices(mesh, graph)]
    bending = _bending(mesh)
    detail = [float(bending[patch].sum()) for patch in patches]
    return patches[int(np.argmin(detail))]


def _patch(mesh: Mesh, graph: sparse.csr_array, centre: int, keep: IntArray) -> BoolArray:
    from_centre = dijkstra(graph, indices=centre)
    distance = from_centre[mesh.faces].max(axis=1)
    area = np.linalg.norm(face_vectors(mesh.vertices, mesh.faces), axis=1)
    kept = np.zeros(len(mesh.vertices), dtype=np.bool_)
    kept[keep] = True
    seed = int(np.argmin(distance))
    enough = OPENED_SHARE * float(area.sum())
    return grown_disk(mesh.faces, twins(mesh.faces), distance, area, kept, seed, enough)


def _edge_graph(mesh: Mesh) -> sparse.csr_array:
    a, b = origins(mesh.faces), targets(mesh.faces)
    length = np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1)
    count = len(mesh.vertices)
    return sparse.csr_array(
        (np.maximum(length, np.finfo(float).tiny), (a, b)), shape=(count, count)
    )


def _spread_vertices(mesh: Mesh, graph: sparse.csr_array) -> list[int]:
    """Vertices far from each other, from the one farthest from the centroid on."""
    offset = mesh.vertices - mesh.vertices.mean(axis=0)
    chosen = [int(np.argmax((offset**2).sum(axis=1)))]
    away: FloatArray = dijkstra(graph, indices=chosen[0])
    while len(chosen) < min(CANDIDATES, len(mesh.vertices)):
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, dijkstra(graph, indices=chosen[-1]))
    return chosen


def _bending(mesh: Mesh) -> FloatArray:
    """Per face, the edge lengths times the angles to the neighbours' normals."""
    normals = face_vectors(mesh.vertices, mesh.faces)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    unit = normals / np.where(length > 0, length, 1)
    across = unit[twins(mesh.faces) // 3].reshape(-1, 3, 3)
    angle = np.arccos(np.clip(np.einsum("fki,fi->fk", across, unit), -1, 1))
    corners = mesh.vertices[mesh.faces]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    return (sides * angle).sum(axis=1)
