"""The insides of mouths, eye sockets and the like: what sees next to nothing of the sky."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import connected_components

from engine.operators import face_areas, interior_edges
from engine.types import BoolArray, FloatArray, IntArray, Mesh

_DIM, _DARK = 0.2, 0.03  # ambient visibility at a cavity's rim, and deep inside
_LEAST_DARK = 0.002  # share of the area that must be dark for a cavity


def find_cavities(mesh: Mesh, visibility: FloatArray) -> tuple[BoolArray, ...]:
    """The faces (m,) of each cavity of ``mesh``, largest first.

    A cavity is a connected dim region that holds enough dark area (hysteresis on the ambient
    ``visibility`` (m,), smoothed over neighbours), with the outside's islands in it.
    """
    areas = face_areas(mesh)
    _, pairs = interior_edges(mesh.faces)
    region = components(_smoothed(visibility, areas, pairs) < _DIM, pairs)
    dark = np.bincount(region + 1, areas * (visibility < _DARK))[1:]
    deep = np.append(dark > _LEAST_DARK * areas.sum(), False)[region]
    if not deep.any():
        return ()
    label = components(~_largest(~deep, areas, pairs), pairs)
    sizes = np.bincount(label + 1, areas)[1:]
    return tuple(label == k for k in np.argsort(-sizes, kind="stable"))


def find_linings(mesh: Mesh, holes: Sequence[IntArray], visibility: FloatArray) -> BoolArray:
    """The faces (m,) inside the edge of a hole: the backs of lips and lids around ``holes``.

    They are as dim as cavities are, but end where ``mesh`` does: the deep of these is missing.
    """
    areas = face_areas(mesh)
    _, pairs = interior_edges(mesh.faces)
    region = components(_smoothed(visibility, areas, pairs) < _DIM, pairs)
    touching = np.isin(mesh.faces, np.concatenate([mesh.faces[:0].ravel(), *holes])).any(axis=1)
    inside = np.isin(region, region[touching & (region >= 0)])
    return np.zeros_like(inside) if inside.all() else ~_largest(~inside, areas, pairs)


def _largest(inside: BoolArray, areas: FloatArray, pairs: IntArray) -> BoolArray:
    """The largest connected part of the faces ``inside``."""
    label = components(inside, pairs)
    return label == np.bincount(label + 1, areas)[1:].argmax()


def _smoothed(values: FloatArray, areas: FloatArray, pairs: IntArray) -> FloatArray:
    """Area-weighted means over each face and its neighbours."""
    a, b = pairs.T
    weight, total = areas.copy(), areas * values
    for here, there in ((a, b), (b, a)):
        weight += np.bincount(here, areas[there], len(areas))
        total += np.bincount(here, (areas * values)[there], len(areas))
    return total / np.maximum(weight, 1e-300)


def components(inside: BoolArray, pairs: IntArray) -> IntArray:
    """Number (m,) of the edge-connected part of ``inside`` that each face is in, -1 elsewhere."""
    a, b = pairs[inside[pairs].all(axis=1)].T
    links = sp.coo_array((np.ones(len(a)), (a, b)), shape=(len(inside), len(inside)))
    label = connected_components(links, directed=False)[1]
    numbers = np.full(len(inside), -1)
    numbers[inside] = np.unique(label[inside], return_inverse=True)[1]
    return numbers
