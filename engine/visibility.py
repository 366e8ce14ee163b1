"""How much of the sky each face sees: what separates skin from the insides of mouth and nose."""

from __future__ import annotations

import numpy as np

from engine._visibility_kernels import add_sky, depth_maps, projected
from engine.operators import face_normals
from engine.types import FloatArray, Mesh

_AXES = 32  # pairs of opposite directions
_PIXELS = 256  # along the diagonal of the surface's bounding box
_LEAST_COSINE = 0.1  # directions nearer to the surface see little and are hard to tell


def ambient_visibility(surface: Mesh, occluders: Mesh | None = None) -> FloatArray:
    """The cosine-weighted share (m,) of the outer hemisphere that each face of ``surface`` sees.

    1 on a convex surface, near 0 deep inside a cavity. ``occluders``, by default the surface
    itself, block the view from both sides; give the whole file, so that eyeballs close their
    sockets. Depth maps from 32 pairs of opposite directions (ambient occlusion by shadow maps,
    Sattler et al. 2003); what is closer than about a pixel, 1/256 of the surface's diagonal,
    does not block.
    """
    solid = occluders or surface
    size = float(np.linalg.norm(np.ptp(surface.vertices, axis=0)))
    if not size > 0:
        return np.ones(len(surface.faces))
    middle = (surface.vertices.min(axis=0) + surface.vertices.max(axis=0)) / 2
    scale = _PIXELS / size
    centres = (surface.vertices[surface.faces].mean(axis=1) - middle) * scale
    blockers = (solid.vertices - middle) * scale
    half_box = np.ptp(surface.vertices, axis=0) / 2 * scale
    normals = face_normals(surface)
    seen, sky = np.zeros(len(normals)), np.zeros(len(normals))
    for frame in _frames(_AXES):
        reach = np.ceil(np.abs(frame) @ half_box)
        shape = (int(2 * reach[1]) + 1, int(2 * reach[0]) + 1)
        maps = depth_maps(projected(blockers, frame, -reach), solid.faces, shape)
        cosines = normals @ frame[2]
        add_sky(sky, seen, projected(centres, frame, -reach), cosines, maps, _LEAST_COSINE)
    return np.divide(seen, sky, out=np.ones_like(sky), where=sky > 0)


def _frames(count: int) -> FloatArray:
    """Orthonormal rows (count, 3, 3), the last ones evenly spread over half a sphere."""
    rank = np.arange(count) + 0.5
    height = 1 - rank / count
    angle = np.pi * (1 + np.sqrt(5)) * rank
    radius = np.sqrt(1 - height**2)
    view = np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)
    least = np.eye(3)[np.abs(view).argmin(axis=1)]
    across = np.cross(view, least)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    frames = np.empty((count, 3, 3))
    frames[:, 0], frames[:, 1], frames[:, 2] = across, np.cross(view, across), view
    return frames
