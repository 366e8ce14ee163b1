"""Faces that a blend leaves turned over, opened a little at every step.

Repairs are found for one shape at a time; where several go beyond, other faces turn over. A face
whose area, as seen along its neighbourhood's normal, is small or negative is asked, the more the
smaller, for the shape that it has within 0 ... 1, turned as its neighbourhood is. A Poisson solve
joins that to the surface as it is. A fixed number of steps, and faces that are next to closed
within 0 ... 1 count for next to nothing: all is continuous in the surface.
"""

from __future__ import annotations

import numpy as np

from engine.operators import face_normals
from engine.restoration._blend import Blender
from engine.restoration._blend_kernels import deformations
from engine.restoration._rotation_kernels import face_covariances, nearest_rotations
from engine.restoration._turned import Orientation
from engine.types import FloatArray

_LEAST = 0.2  # signed area, of the source's: faces below it are opened,
_SHARE = 0.5  # or this share of the area within 0 ... 1, where that is less
_SLIGHT = 0.03  # area within 0 ... 1, likewise: faces that show less there are opened less
_GAIN = 0.7  # of what a face lacks: more opens more of them, but suddenly
_STEPS = 4
_REACH = 0.02  # of the diagonal: how far an opened face takes its surroundings along


class Opening:
    """Opens faces of a ``blender``'s surfaces, which ``orientation`` judges."""

    def __init__(self, blender: Blender, orientation: Orientation) -> None:
        self._blender, self._orientation = blender, orientation
        spread = blender.areas / (_REACH * blender.size) ** 2
        self._factor = blender.held_factor(spread + blender.hold)

    def opened(self, x: FloatArray, within: FloatArray) -> FloatArray:
        """``x`` (n, 3) with fewer faces turned over that ``within`` (n, 3) has open."""
        blender, faces = self._blender, self._blender.mesh.faces
        shapes, own = self._seen(within)
        normal = face_normals(blender.mesh.moved(within))
        least = np.minimum(_LEAST, _SHARE * own)
        gain = _GAIN * np.minimum(own / _SLIGHT, 1.0)
        for _ in range(_STEPS):
            gradients, area = self._seen(x)
            bad = np.flatnonzero(area < least)
            bad = bad[least[bad] > 0]
            if not len(bad):
                break
            sums = self._orientation.rings.sums(face_covariances(faces, within, x, normal))
            turns = nearest_rotations(sums[faces[bad]].sum(axis=1).reshape(-1, 3, 3))
            asked = gain[bad] * np.minimum(1.0 - area[bad] / least[bad], 1.0)
            change = np.zeros_like(gradients)
            change[bad] = asked[:, None, None] * (turns @ shapes[bad] - gradients[bad])
            x = x + self._factor.solve(blender.divergence(change))
        return x

    def _seen(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gradients (m, 3, 2) of the faces and their areas (m,) along what is up."""
        gradients = deformations(self._blender.mesh.faces, self._blender.frames, x)
        normal = np.cross(gradients[:, :, 0], gradients[:, :, 1])
        return gradients, np.einsum("ma,ma->m", normal, self._orientation.up(x))
