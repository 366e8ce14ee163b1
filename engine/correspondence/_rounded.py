"""Targets so coarse that their flat faces lie inside the skin by more than noise.

A chord of length h lies κ h² / 8 inside a surface of curvature κ. The feet of a source that lies on
the skin are then pulled inwards, most in the creases that tell where the skin went.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from engine.correspondence._fitting import Target
from engine.nearest import Feet, NormalAwareIndex, Stars
from engine.operators import face_areas
from engine.types import FloatArray, IntArray, Mesh

_COARSE = 0.015  # square root of the area that a vertex stands for, in those of the source's
_MOST = 0.1  # of its length: how far the middle of an edge is raised
# Barycentric coordinates of the corners of the four faces that a face is divided into.
_DIVIDED = 0.5 * np.array(
    [
        [[2, 0, 0], [1, 1, 0], [1, 0, 1]],
        [[1, 1, 0], [0, 2, 0], [0, 1, 1]],
        [[1, 0, 1], [0, 1, 1], [0, 0, 2]],
        [[1, 1, 0], [0, 1, 1], [1, 0, 1]],
    ]
)


def is_coarse(mesh: Mesh) -> bool:
    """Whether the surface, in square roots of the source's area, is better taken as rounded."""
    used = len(np.unique(mesh.faces))
    return bool(face_areas(mesh).sum() > _COARSE**2 * used)


def angle_normals(mesh: Mesh) -> FloatArray:
    """Unit normals (n, 3), faces weighted by their angles at the vertex: on coarse surfaces nearer
    to those of the surface meant than by areas (Thürmer, Wüthrich 1998)."""
    corner = mesh.vertices[mesh.faces]
    ahead, back = np.roll(corner, -1, axis=1) - corner, np.roll(corner, 1, axis=1) - corner
    cross = np.cross(ahead, back)
    sine, cosine = np.linalg.norm(cross, axis=2), np.einsum("mij,mij->mi", ahead, back)
    turned = cross * (np.arctan2(sine, cosine) / np.maximum(sine, 1e-300))[:, :, None]
    total = np.zeros_like(mesh.vertices)
    np.add.at(total, mesh.faces, turned)
    return total / np.maximum(np.linalg.norm(total, axis=1), 1e-300)[:, None]


def rounded(mesh: Mesh) -> tuple[Mesh, IntArray]:
    """Every face divided into four, the middles of its edges raised onto the skin.

    By (n_j - n_i) · (x_j - x_i) / 8 along the mean normal, as the normals n at an edge's ends have
    it (PN triangles, Vlachos et al. 2001); border edges stay straight. The mesh's own vertices come
    first; of the faces those at first corners, then at second ones, at third ones, and in the
    middle. Also the ends (k, 2) of the edges, in order, the smaller one first.
    """
    n, normals = len(mesh.vertices), angle_normals(mesh)
    ends = np.sort(np.stack([mesh.faces, np.roll(mesh.faces, -1, axis=1)], axis=2), axis=2)
    key, place, times = np.unique(ends @ np.array([n, 1]), return_inverse=True, return_counts=True)
    i, j = np.divmod(key, n)
    along, mean = mesh.vertices[j] - mesh.vertices[i], normals[i] + normals[j]
    mean /= np.maximum(np.linalg.norm(mean, axis=1), 1e-300)[:, None]
    most = _MOST * np.linalg.norm(along, axis=1)
    height = np.clip(np.einsum("ki,ki->k", normals[j] - normals[i], along) / 8, -most, most)
    height[times < 2] = 0
    middle = (mesh.vertices[i] + mesh.vertices[j]) / 2 + height[:, None] * mean
    x, y, z = mesh.faces.T
    xy, yz, zx = place.reshape(mesh.faces.shape).T + n
    faces = np.concatenate(
        [
            np.stack(corners, axis=1)
            for corners in ((x, xy, zx), (xy, y, yz), (zx, yz, z), (xy, yz, zx))
        ]
    )
    finer = Mesh(np.concatenate([mesh.vertices, middle]), faces)
    return finer, np.stack([i, j], axis=1)


class RoundedTarget(Target):
    """A target whose feet lie on its rounded faces, told in its own ones."""

    def __init__(self, mesh: Mesh) -> None:
        self._finer = rounded(mesh)[0]
        super().__init__(mesh)
        self.normals = angle_normals(mesh)

    def _searched(self, normal_weight: float, stars: Stars | None) -> NormalAwareIndex:
        return _RoundedIndex(self._finer, normal_weight, stars)


class _RoundedIndex(NormalAwareIndex):
    """The index of a ``rounded`` surface; its feet name faces of the one it was made from."""

    def feet(self, points: FloatArray, normals: FloatArray) -> Feet:
        found = super().feet(points, normals)
        quarter, face = np.divmod(found.face, len(self.mesh.faces) // 4)
        barycentric = np.einsum("kc,kci->ki", found.barycentric, _DIVIDED[quarter])
        return replace(found, face=face, barycentric=barycentric)
