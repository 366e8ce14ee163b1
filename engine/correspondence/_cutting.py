"""A surface without some of its faces, as a surface of its own."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from engine.operators import face_areas, interior_edges
from engine.topology import boundary_loops
from engine.types import BoolArray, IntArray, Mesh

_TRIMS = 5
_SMOOTHINGS = 3


@dataclass(frozen=True, slots=True)
class Part:
    """Some faces of a surface over the vertices ``vertex`` (k,) of it that they use.

    ``loops`` are its boundary; where it is ``fresh`` (k,), from the cut, it is smoothed.
    """

    mesh: Mesh
    vertex: IntArray
    loops: tuple[IntArray, ...]
    fresh: BoolArray


def part_without(mesh: Mesh, faces: BoolArray, loops: tuple[IntArray, ...]) -> Part:
    """The largest connected part of ``mesh``, with boundary ``loops``, without ``faces`` (m,)."""
    if not faces.any():
        n = len(mesh.vertices)
        return Part(mesh, np.arange(n), loops, np.zeros(n, dtype=np.bool_))
    kept = mesh.faces[_trimmed(mesh, ~faces)]
    vertex, flat = np.unique(kept, return_inverse=True)
    corners = flat.reshape(-1, 3)
    old = np.zeros(len(mesh.vertices), dtype=np.bool_)
    old[np.concatenate([vertex[:0], *loops])] = True
    positions = mesh.vertices[vertex]
    rims = boundary_loops(corners, len(vertex))
    fresh = np.zeros(len(vertex), dtype=np.bool_)
    for rim in rims:
        new = ~old[vertex[rim]]
        fresh[rim[new]] = True
        for _ in range(_SMOOTHINGS):
            curve = positions[rim]
            even = (2 * curve + np.roll(curve, 1, 0) + np.roll(curve, -1, 0)) / 4
            positions[rim[new]] = even[new]
    return Part(Mesh(positions, corners), vertex, rims, fresh)


def _trimmed(mesh: Mesh, kept: BoolArray) -> BoolArray:
    """``kept`` (m,) without faces that hang on by one edge or touch its border's bow-ties."""
    _, pairs = interior_edges(mesh.faces)
    full = np.bincount(pairs.ravel(), minlength=len(kept))
    for _ in range(_TRIMS):
        inner = pairs[kept[pairs].all(axis=1)]
        joined = np.bincount(inner.ravel(), minlength=len(kept))
        corners = mesh.faces[kept]
        bows = np.isin(mesh.faces, _bow_ties(corners)).any(axis=1)
        loose = kept & (((joined <= 1) & (full >= 2)) | bows)
        if not loose.any():
            break
        kept = kept & ~loose
    inner = pairs[kept[pairs].all(axis=1)]
    links = sp.coo_array((np.ones(len(inner)), tuple(inner.T)), shape=(len(kept), len(kept)))
    label = connected_components(links, directed=False)[1]
    sizes = np.bincount(label[kept], face_areas(mesh)[kept])
    return kept & (label == sizes.argmax())


def _bow_ties(faces: IntArray) -> IntArray:
    """Vertices with more than two border edges."""
    halves = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    ends, counts = np.unique(halves, axis=0, return_counts=True)
    vertex, times = np.unique(ends[counts == 1], return_counts=True)
    return vertex[times > 2]
