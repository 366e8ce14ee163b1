"""Rough targets made smooth enough for their normals to mean something."""

from __future__ import annotations

import numpy as np

from engine.operators import adjacency, vertex_normals
from engine.types import FloatArray, Mesh

_ROUGH = 0.09  # of the edges' length
_STEPS = 4
_IN, _OUT = 0.5, 0.53  # of the way to the neighbours' mean, and back


def steadied(mesh: Mesh) -> Mesh:
    """``mesh``, smoothed if it is as rough as a sensor's noise.

    Rough: the height of most vertices over their neighbours' mean differs from that of their
    neighbours by ``_ROUGH`` edges (depth cameras 0.12 to 0.17; remeshed faces, coarse ones too,
    0.03 to 0.06). The planes that a fit goes by shall be those of the surface.
    Each step gives back what its smoothing shrinks (Taubin, 1995).
    """
    links = adjacency(mesh.faces, len(mesh.vertices))
    degree = np.maximum(np.bincount(links.indices, minlength=len(mesh.vertices)), 1)

    def around(values: FloatArray) -> FloatArray:
        mean: FloatArray = ((links @ values).T / degree).T
        return mean

    x = mesh.vertices
    height = np.einsum("ni,ni->n", x - around(x), vertex_normals(mesh))
    used = np.unique(mesh.faces)
    edges = x[mesh.faces] - x[np.roll(mesh.faces, 1, axis=1)]
    rough = np.median(np.abs(height - around(height))[used])
    if rough < _ROUGH * np.median(np.linalg.norm(edges, axis=2)):
        return mesh
    lone = np.setdiff1d(np.arange(len(x)), used)
    for _ in range(_STEPS):
        x = x + _IN * (around(x) - x)
        x = x - _OUT * (around(x) - x)
    x[lone] = mesh.vertices[lone]
    return mesh.moved(x)
