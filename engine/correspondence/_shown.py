"""How surely what a target shows near a source vertex is that vertex's own skin."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from engine.correspondence._curves import ClosedCurve
from engine.correspondence._spreading import Spreading
from engine.correspondence._static import Nearby
from engine.operators import face_areas, vertex_areas, vertex_normals
from engine.types import FloatArray, IntArray, Mesh

_WITHIN = (0.3, 0.6)  # share of its surroundings from which on skin begins to count, and does
_BESIDE = 9.0  # radius around a filled hole, in areas of the hole per length of its rim
_ROUND = (0.545, 0.6)  # openness of a hole from which it begins to show what fills it, and does
_TURNS, _AWAY = 50, 0.01  # tries to find a view, and the share of the area that it may not see
_OPEN = 0.3  # ambient visibility from which on skin is seen


def within_share(nearby: Nearby, spread: Spreading) -> FloatArray:
    """(n,) in [0, 1]: 0 where a vertex and those around it lie beyond the target's borders.

    What lies beyond would be pulled in across the border, by feet that resemble it by chance.
    """
    low, high = _WITHIN
    inside = spread((~nearby.feet.on_border).astype(np.float64))
    return np.clip((inside - low) / (high - low), 0, 1)


def own_share(source: Mesh, filled: Sequence[IntArray]) -> FloatArray:
    """(n,) in [0, 1]: low beside holes of the source, their loops ``filled``, that are none there.

    Where a hole ought to be, a target shows what is not the source's: eyeballs, lashes, teeth. A
    slit closes over it instead.
    """
    share = np.ones(len(source.vertices))
    for loop in filled:
        curve = ClosedCurve(source.vertices[loop])
        low, high = _ROUND
        shows = np.clip((curve.openness - low) / (high - low), 0, 1)
        radius = _BESIDE * shows * float(np.linalg.norm(curve.vector_area)) / curve.length
        distance = KDTree(curve.points).query(source.vertices)[0]
        share = np.minimum(share, -np.expm1(-((distance / max(radius, 1e-9)) ** 2)))
    return share


def exposed_share(source: Mesh, visibility: FloatArray) -> FloatArray:
    """(n,) in [0, 1]: near 0 where skin is hidden in folds, which no sensor sees.

    ``visibility`` (m,) is the ambient visibility of the source's faces.
    """
    areas = np.repeat(face_areas(source), 3)
    corners, count = source.faces.ravel(), len(source.vertices)
    seen = np.bincount(corners, areas * np.repeat(visibility, 3), count)
    around = np.bincount(corners, areas, count)
    return np.clip(seen / np.maximum(around, 1e-300) / _OPEN, 0, 1) ** 2


def is_one_view(mesh: Mesh) -> bool:
    """Whether all of a surface can face one viewer, as what a camera saw does.

    Sought by the perceptron (Rosenblatt, 1958): a direction with which every normal agrees.
    """
    normals, areas = vertex_normals(mesh), vertex_areas(mesh)
    view = areas @ normals
    for _ in range(_TURNS):
        away = areas * (normals @ view <= 0)
        if away.sum() <= _AWAY * areas.sum():
            return True
        view += away @ normals
    return False
