"""How sure the correspondence of each source vertex is."""

from __future__ import annotations

import numpy as np

from engine.correspondence._fitting import Target, welsch
from engine.correspondence._projection import Projection
from engine.correspondence._unfolding import turned_faces
from engine.types import FloatArray, Mesh

_FAR = 0.02  # width of the trust in a foot's distance, in square roots of the source's area
_COSINES = (0.3, 0.8)  # between the normals: no trust below, full trust above


def existence(projection: Projection) -> FloatArray:
    """(n,) in [0, 1]: whether the target has the point at all.

    0 where the foot is on the target's border and nothing says that the vertex belongs there,
    and where normals contradict; falling with the distance of the foot.
    """
    low, high = _COSINES
    agree = np.clip((projection.cosine - low) / (high - low), 0, 1)
    near = welsch(projection.feet.distance, _FAR)
    return np.where(projection.beyond, 0.0, agree * near)


def confidence(source: Mesh, projection: Projection, target: Target) -> FloatArray:
    """(n,) in [0, 1]: existence; 0 at the vertices of turned faces, where the map is none."""
    sure = existence(projection)
    turned = turned_faces(source, projection.points, target)
    sure[np.unique(source.faces[turned])] = 0.0
    return sure
