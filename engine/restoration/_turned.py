"""Triangles that an edit turned over or crushed."""

from __future__ import annotations

import numpy as np

from engine.operators import adjacency, face_areas, face_normals
from engine.restoration._rotation_kernels import nearest_rotations
from engine.types import FloatArray, IntArray, Mesh

_ROUNDS = 2  # rings of faces whose common rotation a face is compared with


def turned_faces(
    mesh: Mesh, before: FloatArray, after: FloatArray, *, least_area_ratio: float = 1e-3
) -> IntArray:
    """Faces of ``after`` (n, 3) inverted or collapsed relative to ``before`` (n, 3).

    Inverted: the normal points against its old self turned with the neighbourhood. Collapsed:
    the area fell below ``least_area_ratio`` of the old one, after scaling to equal total area.
    Faces without area before are not judged.
    """
    old, new = mesh.moved(before), mesh.moved(after)
    area, new_area = face_areas(old), face_areas(new)
    total, new_total = area.sum(), new_area.sum()
    if new_total == 0:
        return np.flatnonzero(area > 0)
    corners, new_corners = before[mesh.faces], after[mesh.faces]
    edge = np.roll(corners, -1, axis=1) - corners
    new_edge = np.roll(new_corners, -1, axis=1) - new_corners
    normal, new_normal = face_normals(old), face_normals(new)
    covariance = np.einsum("mka,mkb->mab", new_edge, edge)
    covariance += 4 * np.einsum("m,ma,mb->mab", new_area, new_normal, normal)
    rotation = nearest_rotations(_gathered(mesh, covariance))
    upright = np.einsum("ma,mab,mb->m", new_normal, rotation, normal)
    crushed = new_area * total < least_area_ratio * area * new_total
    return np.flatnonzero((area > 0) & ((upright < 0) | crushed))


def _gathered(mesh: Mesh, values: FloatArray) -> FloatArray:
    n = len(mesh.vertices)
    flat = np.repeat(values.reshape(-1, 9), 3, axis=0)
    corner = mesh.faces.ravel()
    at = np.stack([np.bincount(corner, flat[:, k], n) for k in range(9)], axis=1)
    ring = adjacency(mesh.faces, n)
    for _ in range(_ROUNDS - 1):
        at = at + ring @ at
    return np.ascontiguousarray(at[mesh.faces].sum(axis=1)).reshape(-1, 3, 3)
