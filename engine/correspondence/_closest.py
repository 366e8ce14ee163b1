"""The paper's correspondence: closest points after the rigid alignment."""

from __future__ import annotations

import numpy as np
from scipy.spatial import KDTree

from engine.types import Correspondence, Registration, Surface, SurfacePoints


def closest_vertices(
    source: Surface, target: Surface, registration: Registration
) -> Correspondence:
    """Step 2 of Algorithm 2 after its last iteration: the closest vertex of the target."""
    faces = target.mesh.faces
    used, first = np.unique(faces, return_index=True)
    aligned = registration.source_from_target(target.mesh.vertices[used])
    nearest = KDTree(aligned).query(source.mesh.vertices)[1]
    corner = first[nearest]
    barycentric = np.zeros((len(corner), 3))
    barycentric[np.arange(len(corner)), corner % 3] = 1.0
    points = SurfacePoints(corner // 3, barycentric)
    mode = "closest vertices after rigid alignment"
    return Correspondence(points, np.ones(len(corner)), np.zeros((len(corner), 3)), mode)
