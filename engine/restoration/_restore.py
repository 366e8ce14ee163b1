"""The one-call entry: a surface from positions known more or less, by either method."""

from __future__ import annotations

from typing import Literal

import numpy as np

from engine.restoration._carry import Restorer
from engine.restoration._paper import restore_paper
from engine.types import FloatArray, Mesh


def restore(
    mesh: Mesh,
    positions: FloatArray,
    confidence: FloatArray,
    *,
    method: Literal["default", "paper"] = "default",
) -> FloatArray:
    """Vertices (n, 3) of ``mesh`` in the shape that ``positions`` (n, 3) describe.

    ``confidence`` (n,) in [0, 1]; positions with confidence 0 are ignored. ``"default"`` keeps
    the mesh's details (``Restorer.carry``, which also serves many targets); ``"paper"`` is
    Algorithm 5 as printed, knowing every vertex with confidence.
    Raises ``RestorationError`` when too little is known.
    """
    if method == "paper":
        known = np.flatnonzero(confidence > 0)
        return restore_paper(mesh, known, positions[known])
    return Restorer(mesh).carry(positions, confidence)
