"""Sheets among the passengers: gums, lashes, films. They bend with what they are attached to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from engine.linalg import Factor, SymmetricPattern
from engine.topology import position_classes
from engine.types import BoolArray, FloatArray, IntArray, Mesh

NEAR = 0.005
"""Distance, in surface diagonals, over which an attachment fades."""

SPREAD = 0.005
"""Length along the sheet, in surface diagonals, over which attachments act on the rest of it."""

SKIN = 0.15
"""How firmly skin holds a sheet, as a share of how firmly solids do: bone leads, skin follows."""

STITCHED = 1e-6
"""Distance, in surface diagonals, up to which a sheet counts as sewn to the skin, as lashes and the
films of the eye are to the lids: then no solid holds it, however near."""

_LEAST = 1e-6


@dataclass(frozen=True, slots=True)
class Soft:
    """File ``vertices`` (s,) of sheets and what leads them.

    Each is led by rigid body ``body`` with weight ``to_body``, and by the surface vertex ``skin``
    with weight ``to_skin``; ``factor`` spreads these over ``place`` (s,), its distinct places.
    """

    vertices: IntArray
    place: IntArray
    body: IntArray
    to_body: FloatArray
    skin: IntArray
    to_skin: FloatArray
    factor: Factor


def bind(mesh: Mesh, soft: BoolArray, body: IntArray, skin: KDTree, diagonal: float) -> Soft | None:
    """Attach the ``soft`` (n,) vertices of ``mesh`` to the rigid ones (``body`` >= 0) and skin."""
    vertices = np.flatnonzero(soft)
    if not len(vertices):
        return None
    points = mesh.vertices[vertices]
    place = np.unique(position_classes(points), return_inverse=True)[1]
    to_skin, nearest = skin.query(points)
    solid = np.flatnonzero(body >= 0)
    led = np.full(len(vertices), -1, dtype=np.int64)
    to_body = np.full(len(vertices), np.inf)
    if len(solid):
        to_body, which = KDTree(mesh.vertices[solid]).query(points)
        led = body[solid[which]]
    reach = NEAR * diagonal
    nearer = 1 / (1 + (to_body / np.maximum(to_skin, _LEAST * diagonal)) ** 2)
    by_body = nearer * np.exp(-0.5 * (to_body / reach) ** 2)
    by_skin = SKIN * (1 - nearer) * np.exp(-0.5 * (to_skin / reach) ** 2) + _LEAST
    stiff = _stiffness(mesh, vertices, place) * (SPREAD * diagonal) ** 2
    sewn = _with_any(stiff, place, to_skin <= STITCHED * diagonal)
    by_body[sewn] = 0.0
    by_skin[sewn] = np.exp(-0.5 * (to_skin[sewn] / reach) ** 2) + _LEAST
    hold = np.bincount(place, by_body + by_skin)
    pattern, data = SymmetricPattern.of(stiff + sp.diags_array(hold))
    return Soft(
        vertices,
        place,
        led,
        by_body,
        np.asarray(nearest, dtype=np.int64),
        by_skin,
        pattern.factor(data),
    )


def _with_any(links: sp.csr_array, place: IntArray, chosen: BoolArray) -> BoolArray:
    """(s,) which vertices hang together, by the ``links`` of their places, with a chosen one."""
    part = connected_components(links, directed=False)[1][place]
    return np.isin(part, part[chosen])


def _stiffness(mesh: Mesh, vertices: IntArray, place: IntArray) -> sp.csr_array:
    """The graph Laplacian of the sheets' places, edges weighted by 1 / length^2."""
    of_vertex = np.full(len(mesh.vertices), -1, dtype=np.int64)
    of_vertex[vertices] = place
    sides = mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    ends = of_vertex[sides]
    kept = (ends >= 0).all(axis=1) & (ends[:, 0] != ends[:, 1])
    ends, sides = np.sort(ends[kept], axis=1), sides[kept]
    _, once = np.unique(ends, axis=0, return_index=True)
    ends, sides = ends[once], sides[once]
    length = np.linalg.norm(mesh.vertices[sides[:, 0]] - mesh.vertices[sides[:, 1]], axis=1)
    weight = 1.0 / length**2
    count = int(place.max()) + 1
    graph = sp.csr_array((weight, (ends[:, 0], ends[:, 1])), shape=(count, count))
    graph = graph + graph.T
    return sp.csr_array(sp.diags_array(graph.sum(axis=1)) - graph)


def follow(soft: Soft, by_body: FloatArray, by_skin: FloatArray) -> FloatArray:
    """Displacements (s, 3) from those that the bodies and the skin would give each vertex."""
    pull = soft.to_body[:, None] * by_body + soft.to_skin[:, None] * by_skin
    count = int(soft.place.max()) + 1
    right = np.zeros((count, 3))
    for k in range(3):
        right[:, k] = np.bincount(soft.place, pull[:, k], count)
    return soft.factor.solve(right)[soft.place]
