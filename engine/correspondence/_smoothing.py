"""Rough targets made smooth enough for their normals to mean something."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from engine.correspondence._bilateral import denoised
from engine.operators import adjacency, vertex_normals
from engine.types import FloatArray, Mesh

_ROUGH = 0.09  # of the edges' length
_FAINT, _PLAIN = 0.043, 0.08  # roughness from which, at which normals are averaged with others
_TILT = 0.12  # how far these may be apart there
_MOST = 2.0  # standard deviations that a vertex may be off
_STEPS = 4
_IN, _OUT = 0.5, 0.53  # of the way to the neighbours' mean, and back


@dataclass(frozen=True, slots=True)
class Steadied:
    """A target's surface as its planes are to be taken.

    How ``rough`` it was in edges, ``blurred`` in [0, 1] how much of what it tells is noise, and how
    far ``off`` it its vertices were, as a length: both 0 where they are as remeshing leaves them,
    and where it is ``coarse``, so that roughness may be shape.
    """

    mesh: Mesh
    coarse: bool
    rough: float
    blurred: float
    off: float

    @property
    def noisy(self) -> bool:
        """Whether it was as rough as a sensor's noise (depth cameras: 0.12 to 0.17 edges)."""
        return self.rough >= _ROUGH


def steadied(mesh: Mesh, *, coarse: bool = False) -> Steadied:
    """``mesh``, the smoother the rougher it is: the planes that a fit goes by shall be those of the
    surface. A ``coarse`` one is smoothed only if a sensor's noise is in it."""
    rough = roughness(mesh)
    coarse &= rough < _ROUGH
    blurred = 0.0 if coarse else float(np.clip((rough - _FAINT) / (_PLAIN - _FAINT), 0, 1))
    if blurred == 0:
        return Steadied(mesh, coarse, rough, 0.0, 0.0)
    smooth = _smoothed(mesh) if rough >= _ROUGH else denoised(mesh, _TILT * blurred)
    return Steadied(smooth, coarse, rough, blurred, _MOST * blurred * rough * _edge(mesh))


def roughness(mesh: Mesh) -> float:
    """How much most vertices' height over their neighbours' mean differs from theirs, in edges.

    Remeshed faces, coarse ones too: 0.03 to 0.06.
    """
    x, around = mesh.vertices, _averaging(mesh)
    height = np.einsum("ni,ni->n", x - around(x), vertex_normals(mesh))
    used = np.bincount(mesh.faces.ravel(), minlength=len(x)) > 0
    rough = np.median(np.abs(height - around(height))[used])
    return float(rough / max(_edge(mesh), 1e-300))


def _edge(mesh: Mesh) -> float:
    """The median length of the edges."""
    corner = mesh.vertices[mesh.faces]
    return float(np.median(np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2)))


def _averaging(mesh: Mesh) -> Callable[[FloatArray], FloatArray]:
    """What gives each vertex the mean of its neighbours' values (n, …), 0 where it has none."""
    links = adjacency(mesh.faces, len(mesh.vertices))
    degree = np.maximum(np.bincount(links.indices, minlength=len(mesh.vertices)), 1)

    def around(values: FloatArray) -> FloatArray:
        mean: FloatArray = ((links @ values).T / degree).T
        return mean

    return around


def _smoothed(mesh: Mesh) -> Mesh:
    """``mesh`` with its vertices among their neighbours; each step gives back what its smoothing
    shrinks (Taubin, 1995)."""
    x, around = mesh.vertices, _averaging(mesh)
    lone = np.setdiff1d(np.arange(len(x)), mesh.faces)
    for _ in range(_STEPS):
        x = x + _IN * (around(x) - x)
        x = x - _OUT * (around(x) - x)
    x[lone] = mesh.vertices[lone]
    return mesh.moved(x)
