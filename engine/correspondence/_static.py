"""Which vertices an expression has most likely left where they were."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from engine.correspondence._cavities import components
from engine.correspondence._fitting import Target
from engine.correspondence._spreading import Spreading
from engine.nearest import Feet
from engine.operators import interior_edges, vertex_areas, vertex_normals
from engine.types import BoolArray, FloatArray, IntArray, Mesh

_NEAR = 0.003  # how closely skin at rest coincides, in square roots of the area
AROUND = 0.05
"""Radius of the neighbourhood that must rest, or be shown, too."""

_NORMALS = 0.1  # weight of normals when a source at rest is looked up
_TOLERATED = 0.25  # share of the neighbourhood that may have moved
_BESIDE = 0.01  # that radius in a cavity of which most rests
_CALM = (0.75, 0.85)  # share of a cavity at rest from which the rest is likely to be, and surely
_BESIDE_RIM, _RESTING_RIM = 0.03, 0.33  # around a rim: share at rest from which its skin rests
_REMOTE = (0.1, 0.3)  # from a hole: where skin begins to rest, and where it rests fully
_MOVES, _APART = 0.5, 0.03  # static share below which skin moves, and how far that may tell
_EDGE = 0.07  # how far from its border a patch is held that nothing else ties


@dataclass(frozen=True, slots=True)
class Nearby:
    """What a target shows nearest to each vertex of a source at rest.

    Its ``feet``, and the ``cosine`` (n,) between the normals of the source and those there.
    """

    feet: Feet
    cosine: FloatArray

    @classmethod
    def of(cls, source: Mesh, target: Target) -> Nearby:
        """What the aligned ``target`` shows next to ``source``."""
        normals = vertex_normals(source)
        feet = target.index(_NORMALS).feet(source.vertices, normals)
        return cls(feet, np.einsum("ni,ni->n", normals, feet.normal))


def static_share(nearby: Nearby, spread: Spreading) -> FloatArray:
    """(n,) in [0, 1]: near 1 where a vertex and all around it already lie on the target."""
    near = np.exp(-((nearby.feet.distance / _NEAR) ** 2))
    rests = near * np.clip((nearby.cosine - 0.5) / 0.4, 0, 1)
    return rests * np.exp(-((spread(1 - rests) / _TOLERATED) ** 2))


def calm_share(source: Mesh, inside: BoolArray, nearby: Nearby) -> FloatArray:
    """(n,) in [0, 1]: static shares of vertices ``inside`` cavities of which most rests; else 0.

    A jaw moves half a mouth; a lid nothing of the socket behind it, up to where it begins.
    """
    static = static_share(nearby, Spreading.over(source, _BESIDE)) * inside
    touched = inside[source.faces].sum(axis=1) > 0
    label = components(touched, interior_edges(source.faces)[1])
    areas = vertex_areas(source) * inside
    calm = np.zeros(len(source.vertices))
    least, full = _CALM
    for k in range(label.max() + 1):
        vertex = np.unique(source.faces[label == k])
        resting = (areas * static)[vertex].sum() / max(areas[vertex].sum(), 1e-300)
        calm[vertex] = np.clip((resting - least) / (full - least), 0, 1)
    return static * calm


def rests_beside(points: FloatArray, rim: FloatArray, static: FloatArray) -> bool:
    """Whether skin at ``points`` (n, 3) around a ``rim`` (k, 3) rests, by its ``static`` (n,).

    Lids that close change a rim, not the face.
    """
    around = KDTree(rim).query(points)[0] < _BESIDE_RIM
    return float(static[around].mean()) > _RESTING_RIM


def apart_share(source: Mesh, static: FloatArray) -> FloatArray:
    """(n,) in [0, 1]: 1 far from skin that moves, by the ``static`` (n,) share, 0 next to it."""
    moves = static < _MOVES
    if not moves.any():
        return np.ones(len(static))
    distance = KDTree(source.vertices[moves]).query(source.vertices)[0]
    return 1 - np.exp(-((distance / _APART) ** 2))


def edge_share(source: Mesh, loop: IntArray) -> FloatArray:
    """(n,) in [0, 1]: 1 at the border ``loop`` (k,) of a patch, falling off within ``_EDGE``."""
    distance = KDTree(source.vertices[loop]).query(source.vertices)[0]
    return np.exp(-((distance / _EDGE) ** 2))


def remote_share(source: Mesh, loops: Sequence[IntArray]) -> FloatArray:
    """(n,) in [0, 1]: 1 far from the holes of a patch, its inner ``loops``; 0 if it has none.

    What moves a face surrounds its eyes and mouth: skin far from them slides but little, whatever
    smoothness carries on from there.
    """
    inner = [source.vertices[loop] for loop in loops[1:]]
    if not inner:
        return np.zeros(len(source.vertices))
    distance = KDTree(np.concatenate(inner)).query(source.vertices)[0]
    near, far = _REMOTE
    return np.clip((distance - near) / (far - near), 0, 1) ** 2
