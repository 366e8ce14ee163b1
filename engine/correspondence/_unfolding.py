"""Places where a projection turns faces over, laid out again in charts of the target.

In a crease closest points jump from side to side. There a piece of the target is mapped to a
disk (Tutte 1963: positive weights, convex rim) and the images of the source's vertices are
spread in it by the same kind of weights, with those around held.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from engine.correspondence._energy import clipped_laplacian
from engine.correspondence._fitting import Target
from engine.linalg import FixedSolver
from engine.locate import locate_in_plane
from engine.nearest import vertex_stars
from engine.operators import adjacency, edges, face_normals
from engine.topology import boundary_loops
from engine.types import BoolArray, ComplexArray, FloatArray, IntArray, Mesh, SurfacePoints

_ROUNDS = 4
_PATCH_RINGS = 2  # of the target around the images


def turned_faces(source: Mesh, points: SurfacePoints, target: Target) -> BoolArray:
    """(m,) faces of the source whose image on the target lies upside down there."""
    normals = face_normals(Mesh(points.on(target.mesh), source.faces))
    corners = target.mesh.faces[points.face]
    below = np.einsum("ni,nij->nj", points.barycentric, target.normals[corners])
    return np.einsum("mi,mi->m", normals, below[source.faces].sum(axis=1)) <= 0


def unfolded(
    source: Mesh, points: SurfacePoints, target: Target, held: BoolArray, exists: BoolArray
) -> SurfacePoints:
    """``points`` (n,) of the target with the faces that they turn over laid out again.

    ``held`` (n,) vertices and those of the border keep their points; faces with a vertex that
    does not ``exists`` (n,) on the target are left as they are. Each round begins at the faces
    that are still turned and takes one more ring of the source around them.
    """
    held = held | vertex_stars(source.faces, len(source.vertices)).border
    ours = adjacency(source.faces, len(source.vertices))
    theirs = adjacency(target.mesh.faces, len(target.mesh.vertices))
    for rings in range(1, _ROUNDS + 1):
        turned = turned_faces(source, points, target) & exists[source.faces].all(axis=1)
        if not turned.any():
            break
        near = np.zeros(len(source.vertices), dtype=np.bool_)
        near[source.faces[turned]] = True
        near = _dilated(near, ours, rings)
        for region in _pieces(near, ours):
            around = _dilated(region, ours, 1)
            chart = _chart(target.mesh, points.face[around], theirs)
            free = region & ~held
            if chart is not None and free.any():
                points = _spread(source, points, around, free, chart)
    return points


@dataclass(frozen=True, slots=True)
class _Chart:
    """A piece of the target on the unit disk: its ``faces`` there, ``corners`` into ``z``."""

    faces: IntArray
    corners: IntArray
    z: ComplexArray


def _dilated(chosen: BoolArray, links: sp.csr_array, rings: int) -> BoolArray:
    for _ in range(rings):
        chosen = chosen | (links @ chosen.astype(np.float64) > 0)
    return chosen


def _pieces(chosen: BoolArray, links: sp.csr_array) -> list[BoolArray]:
    """The connected parts of ``chosen`` (n,) vertices."""
    vertices = np.flatnonzero(chosen)
    count, part = connected_components(links[vertices][:, vertices], directed=False)
    pieces = [np.zeros_like(chosen) for _ in range(count)]
    for k, piece in enumerate(pieces):
        piece[vertices[part == k]] = True
    return pieces


def _chart(mesh: Mesh, faces: IntArray, links: sp.csr_array) -> _Chart | None:
    """The disk around ``faces``, perhaps with convex holes; None if they make no such piece."""
    near = np.zeros(len(mesh.vertices), dtype=np.bool_)
    near[mesh.faces[faces]] = True
    near = _dilated(near, links, _PATCH_RINGS)
    chosen = np.flatnonzero(near[mesh.faces].all(axis=1))
    vertices, flat = np.unique(mesh.faces[chosen], return_inverse=True)
    corners = flat.reshape(-1, 3)
    rims = boundary_loops(corners, len(vertices))
    euler = len(vertices) - len(edges(corners)) + len(corners)
    if not rims or euler != 2 - len(rims):
        return None
    patch = Mesh(mesh.vertices[vertices], corners)
    lengths = [_along(patch, rim) for rim in rims]
    outer = int(np.argmax([along[-1] for along in lengths]))
    circle = np.exp(2j * np.pi * lengths[outer] / lengths[outer][-1])
    z = FixedSolver(clipped_laplacian(patch), rims[outer]).solve(circle)
    return _Chart(chosen, corners, z)


def _along(mesh: Mesh, loop: IntArray) -> FloatArray:
    """The length of ``loop`` (k,) up to the end of each of its edges."""
    steps = mesh.vertices[np.roll(loop, -1)] - mesh.vertices[loop]
    return np.cumsum(np.linalg.norm(steps, axis=1))


def _spread(
    source: Mesh, points: SurfacePoints, around: BoolArray, free: BoolArray, chart: _Chart
) -> SurfacePoints:
    """The points with those of ``free`` vertices spread between those ``around`` them."""
    chosen = around[source.faces].all(axis=1)
    vertices, flat = np.unique(source.faces[chosen], return_inverse=True)
    piece = Mesh(source.vertices[vertices], flat.reshape(-1, 3))
    place = np.searchsorted(chart.faces, points.face[vertices])
    corners = chart.z[chart.corners[place]]
    z = np.einsum("ki,ki->k", points.barycentric[vertices], corners)
    known = np.flatnonzero(~free[vertices])
    spread = FixedSolver(clipped_laplacian(piece), known).solve(z[known])
    if _negative(spread, piece.faces) >= _negative(z, piece.faces):
        return points
    moved = free[vertices]
    found = locate_in_plane(chart.z, chart.corners, spread[moved])[0]
    face, barycentric = points.face.copy(), points.barycentric.copy()
    face[vertices[moved]] = chart.faces[found.face]
    barycentric[vertices[moved]] = found.barycentric
    return SurfacePoints(face, barycentric)


def _negative(z: ComplexArray, faces: IntArray) -> int:
    """How many faces are not counter-clockwise."""
    a, b, c = z[faces].T
    areas: FloatArray = ((b - a).conj() * (c - a)).imag
    return int((areas <= 0).sum())
