"""Which of the loops that two surfaces seem to share a fit may go by."""

from __future__ import annotations

import numpy as np

from engine.correspondence._curves import ClosedCurve
from engine.correspondence._loops import LoopPair
from engine.correspondence._static import rests_beside
from engine.types import FloatArray, IntArray, Mesh

_INSIDE = 0.8  # of a loop's radius: how far its centre may move in a partial target
_CLOSED = 0.3  # of a hole's area: what is left of it when it closes


def is_likely(source: Mesh, pair: LoopPair, *, seen: bool) -> bool:
    """Whether a partial target's hole may be the source's: scans have many to be mistaken.

    Its centre stays inside the source's, and it surrounds it; what lies beside the line of sight
    of an eye is a crescent around the lid. Only lids of a mesh not ``seen`` by a sensor may close.
    """
    curve = ClosedCurve(source.vertices[pair.vertices])
    radius = max(curve.length, pair.curve.length) / (2 * np.pi)
    near = np.linalg.norm(curve.centroid - pair.curve.centroid) < _INSIDE * radius
    axis, opening = curve.vector_area, np.linalg.norm(pair.curve.vector_area)
    closed = not seen and opening < _CLOSED * np.linalg.norm(axis)
    around = pair.slides or closed or pair.curve.winding(axis, curve.centroid) != 0
    return bool(near and around)


def rests(source: Mesh, pair: LoopPair, static: FloatArray) -> bool:
    """Whether the skin around a cavity's rim rests."""
    return not pair.slides and rests_beside(source.vertices, source.vertices[pair.vertices], static)


def unpaired(loops: tuple[IntArray, ...], pairs: tuple[LoopPair, ...]) -> list[IntArray]:
    """The inner ``loops`` of a source that are in none of ``pairs``."""
    paired = {int(pair.vertices.min()) for pair in pairs}
    return [loop for loop in loops[1:] if int(loop.min()) not in paired]
