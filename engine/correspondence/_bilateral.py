"""Noise taken off a surface whose creases are kept: bilateral normal filtering.

Normals of faces are averaged with those around that are like them (Zheng, Fu, Au, Tai 2011), and
vertices moved until faces stand on them (Sun, Rosin, Martin, Langbein 2007).
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from engine.operators import face_areas, face_normals
from engine.types import FloatArray, Mesh

_STEPS = 2


def denoised(mesh: Mesh, tilt: float) -> Mesh:
    """``mesh`` with its vertices moved as its faces' averaged normals have it.

    ``tilt``: the difference of unit normals over which the weight of a face around falls by √e.
    """
    count = len(mesh.faces), len(mesh.vertices)
    at = np.arange(count[0]).repeat(3), mesh.faces.ravel()
    corners = sp.csr_array((np.ones(3 * count[0]), at), shape=count)
    normals = _averaged(mesh, sp.csr_array(corners @ corners.T), tilt)
    planes = normals[:, :, None] * normals[:, None, :]
    at_vertex = sp.csr_array(corners.T)
    share = 1 / np.maximum(np.bincount(mesh.faces.ravel(), minlength=count[1]), 1)
    total = (at_vertex @ planes.reshape(-1, 9)).reshape(-1, 3, 3)
    x = mesh.vertices
    for _ in range(_STEPS):
        middles = np.einsum("mij,mj->mi", planes, x[mesh.faces].mean(axis=1))
        off = at_vertex @ middles - np.einsum("nij,nj->ni", total, x)
        x = x + share[:, None] * off
    return mesh.moved(x)


def _averaged(mesh: Mesh, around: sp.csr_array, tilt: float) -> FloatArray:
    """Unit normals (m, 3), each a mean of those of the faces ``around`` (m, m) it, and its own."""
    i, j = around.tocoo().coords
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    apart = np.sum((middles[i] - middles[j]) ** 2, axis=1)
    near = face_areas(mesh)[j] * np.exp(-apart / (2 * max(apart.mean(), 1e-300)))
    normals = face_normals(mesh)
    for _ in range(_STEPS):
        unlike = np.sum((normals[i] - normals[j]) ** 2, axis=1)
        weights = near * np.exp(-unlike / (2 * tilt**2))
        normals = sp.csr_array((weights, (i, j)), shape=around.shape) @ normals
        normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-300)[:, None]
    return normals
