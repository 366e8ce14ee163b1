"""Faces in their own planes."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from engine.types import FloatArray, Mesh

_SLIVER = 1e-7  # area over squared longest edge below which a face says nothing


class Frames(NamedTuple):
    """The faces of a mesh in their own planes: what turns corners into gradients and back."""

    tangents: FloatArray  # (m, 3, 2) orthonormal columns
    hats: FloatArray  # (m, 3, 2) gradients of the corners' hat functions
    areas: FloatArray  # (m,), 0 where a face says nothing


def frames_of(mesh: Mesh) -> Frames:
    """The frames of all faces; slivers get some frame, no area, and gradients that are finite."""
    corner = mesh.vertices[mesh.faces]
    first, second = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    normal = np.cross(first, second)
    doubled = np.linalg.norm(normal, axis=1)
    longest = np.square(np.roll(corner, -1, axis=1) - corner).sum(axis=2).max(axis=1)
    good = doubled > 2 * _SLIVER * longest
    length = np.where(good, np.linalg.norm(first, axis=1), 1.0)
    u = np.where(good[:, None], first, [1.0, 0.0, 0.0]) / length[:, None]
    n = np.where(good[:, None], normal / np.where(good, doubled, 1.0)[:, None], [0.0, 0.0, 1.0])
    v = np.cross(n, u)
    height = np.where(good, doubled / length, 1.0)
    along = np.where(good, np.einsum("mi,mi->m", second, u), 0.0)
    hats = np.empty((len(corner), 3, 2))
    hats[:, 1] = np.stack([1 / length, -along / (length * height)], axis=1)
    hats[:, 2] = np.stack([np.zeros_like(height), 1 / height], axis=1)
    hats[:, 0] = -hats[:, 1] - hats[:, 2]
    return Frames(np.stack([u, v], axis=2), hats, np.where(good, 0.5 * doubled, 0.0))
