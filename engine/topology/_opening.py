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
    graph, twin = _edge_graph(mesh), twins(mesh.faces)
    area = np.linalg.norm(face_vectors(mesh.vertices, mesh.faces), axis=1)
    share = area / (OPENED_SHARE * area.sum())
    kept = np.zeros(len(mesh.vertices), dtype=np.bool_)

    def patch(away: FloatArray) -> BoolArray:
        a, b, c = away[mesh.faces.T]
        far = np.maximum(np.maximum(a, b), c)
        return grown_disk(mesh.faces, twin, far, share, kept)

    if keep is not None and len(keep):
        kept[keep] = True
        from_keep = dijkstra(graph, indices=np.flatnonzero(kept), min_only=True)
        return patch(dijkstra(graph, indices=int(np.argmax(from_keep))))
    patches = [patch(away) for away in _spread_distances(mesh, graph)]
    bending = _bending(mesh, twin)
    return patches[int(np.argmin([bending[inside].sum() for inside in patches]))]


def _edge_graph(mesh: Mesh) -> sparse.csr_array:
    a, b = origins(mesh.faces), targets(mesh.faces)
    length = np.linalg.norm(mesh.vertices[a] - mesh.vertices[b], axis=1)
    count = len(mesh.vertices)
    return sparse.csr_array(
        (np.maximum(length, np.finfo(float).tiny), (a, b)), shape=(count, count)
    )


def _spread_distances(mesh: Mesh, graph: sparse.csr_array) -> list[FloatArray]:
    """Distances from vertices far from each other, from the one farthest from the centroid on."""
    offset = mesh.vertices - mesh.vertices.mean(axis=0)
    distances: list[FloatArray] = [dijkstra(graph, indices=int(np.argmax((offset**2).sum(axis=1))))]
    nearest = distances[0]
    while len(distances) < min(CANDIDATES, len(mesh.vertices)):
        distances.append(dijkstra(graph, indices=int(np.argmax(nearest))))
        nearest = np.minimum(nearest, distances[-1])
    return distances


def _bending(mesh: Mesh, twin: IntArray) -> FloatArray:
    """Per face, the edge lengths times the angles to the neighbours' normals."""
    normals = face_vectors(mesh.vertices, mesh.faces)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    unit = normals / np.where(length > 0, length, 1)
    across = unit[twin // 3].reshape(-1, 3, 3)
    angle = np.arccos(np.clip(np.einsum("fki,fi->fk", across, unit), -1, 1))
    corners = mesh.vertices[mesh.faces]
    sides = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2)
    return (sides * angle).sum(axis=1)
