"""How much sky a part of a head would see if nothing of the head were missing."""

from __future__ import annotations

import numpy as np

from engine.correspondence._fitting import Target
from engine.correspondence._static import Nearby
from engine.types import FloatArray, Mesh
from engine.visibility import ambient_visibility

_LEAST_MISSING = 0.1  # share of the faces of the whole that a part lacks


def completed_visibility(whole: Mesh, part: Mesh, visibility: FloatArray) -> FloatArray:
    """The ambient ``visibility`` (m,) of an aligned ``part`` once the ``whole`` closes its gaps.

    Where a head is cut through, light falls into its cavities from the cut. What the whole has
    beyond the part's border, as it rests, is put in its way.
    """
    missing = Nearby.of(whole, Target(part)).feet.on_border[whole.faces].all(axis=1)
    if missing.mean() < _LEAST_MISSING:
        return visibility
    faces = np.concatenate([part.faces, whole.faces[missing] + len(part.vertices)])
    closed = Mesh(np.concatenate([part.vertices, whole.vertices]), faces)
    return np.minimum(visibility, ambient_visibility(part, closed))
