"""Evenly spread points of a surface, with normals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.operators import face_areas, vertex_normals
from engine.types import FloatArray, Mesh


@dataclass(frozen=True, slots=True)
class Samples:
    """``points`` (k, 3) on a surface and the unit ``normals`` there."""

    points: FloatArray
    normals: FloatArray

    def every(self, count: int) -> Samples:
        """About ``count`` of them, evenly spaced."""
        step = max(len(self.points) // count, 1)
        return Samples(self.points[::step][:count], self.normals[::step][:count])


_NEEDLE = 0.3  # shape, of which an equilateral triangle has 1, below which a face is a needle


def fair_areas(mesh: Mesh) -> FloatArray:
    """Areas (m,) of the faces; needles, which spikes are made of, count the median at most."""
    areas = face_areas(mesh)
    corners = mesh.vertices[mesh.faces]
    edges = ((corners - np.roll(corners, 1, axis=1)) ** 2).sum(axis=(1, 2))
    needle = 4 * np.sqrt(3) * areas < _NEEDLE * edges
    positive = areas[areas > 0]
    return np.where(needle, np.minimum(areas, np.median(positive)), areas)


def surface_samples(mesh: Mesh, count: int) -> Samples:
    """``count`` points, systematically spread over the area: the same ones on every run."""
    cumulative = np.cumsum(fair_areas(mesh))
    rank = np.arange(count)
    face = np.searchsorted(cumulative, (rank + 0.5) / count * cumulative[-1])
    # additive recurrence of the plastic number (Roberts 2018), folded into the triangle
    u, v = np.mod((rank + 1) * 0.7548776662466927, 1), np.mod((rank + 1) * 0.5698402909980532, 1)
    beyond = u + v > 1
    u, v = np.where(beyond, 1 - u, u), np.where(beyond, 1 - v, v)
    weights = np.stack((1 - u - v, u, v), axis=1)
    corners = mesh.faces[face]
    normals = vertex_normals(mesh)[corners]
    normal = np.einsum("ki,kij->kj", weights, normals)
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-300)[:, None]
    return Samples(np.einsum("ki,kij->kj", weights, mesh.vertices[corners]), normal)
