"""Rough targets made smooth enough for their normals to mean something."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from engine.operators import adjacency, vertex_normals
from engine.types import FloatArray, Mesh

_ROUGH = 0.09  # of the edges' length
_STEPS = 4
_IN, _OUT = 0.5, 0.53  # of the way to the neighbours' mean, and back


def roughness(mesh: Mesh) -> float:
    """How much most vertices' height over their neighbours' mean differs from theirs, in edges.

    Remeshed faces, coarse ones too: 0.03 to 0.06.
    """
    x, around = mesh.vertices, _averaging(mesh)
    height = np.einsum("ni,ni->n", x - around(x), vertex_normals(mesh))
    edges = x[mesh.faces] - x[np.roll(mesh.faces, 1, axis=1)]
    rough = np.median(np.abs(height - around(height))[np.unique(mesh.faces)])
    return float(rough / max(np.median(np.linalg.norm(edges, axis=2)), 1e-300))


def _averaging(mesh: Mesh) -> Callable[[FloatArray], FloatArray]:
    """What gives each vertex the mean of its neighbours' values (n, …), 0 where it has none."""
    links = adjacency(mesh.faces, len(mesh.vertices))
    degree = np.maximum(np.bincount(links.indices, minlength=len(mesh.vertices)), 1)

    def around(values: FloatArray) -> FloatArray:
        mean: FloatArray = ((links @ values).T / degree).T
        return mean

    return around


def steadied(mesh: Mesh) -> Mesh:
    """``mesh``, smoothed if it is as rough as a sensor's noise (depth cameras: 0.12 to 0.17 edges).

    The planes that a fit goes by shall be those of the surface.
    Each step gives back what its smoothing shrinks (Taubin, 1995).
    """
    if roughness(mesh) < _ROUGH:
        return mesh
    x, around = mesh.vertices, _averaging(mesh)
    lone = np.setdiff1d(np.arange(len(x)), mesh.faces)
    for _ in range(_STEPS):
        x = x + _IN * (around(x) - x)
        x = x - _OUT * (around(x) - x)
    x[lone] = mesh.vertices[lone]
    return mesh.moved(x)
