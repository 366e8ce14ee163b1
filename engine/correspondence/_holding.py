"""How firmly skin is held that rests."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.spatial import KDTree

from engine.correspondence._loops import LoopPair
from engine.correspondence._static import apart_share
from engine.operators import vertex_areas
from engine.types import FloatArray, Mesh

_RESTING, _RAMP = 0.8, 0.08  # share of the area at rest from which resting is the likely story
_FIRM, _BESIDE_LID = 5.0, 0.06  # how much firmer skin at rest is held beside a lid that closes
_CALMED = 40.0  # and how much more, far from what moves, where vertices tell but noise


def held_firmly(
    source: Mesh,
    loops: Sequence[LoopPair],
    static: FloatArray,
    shown: FloatArray,
    blurred: float,
) -> tuple[FloatArray, float, str]:
    """How firmly vertices (n,) are held that rest, in [0, 1] how far this is trusted, and why.

    ``static`` (n,): how surely each rests; ``shown`` (n,): how surely the target has it;
    ``blurred`` in [0, 1]: how much of what the target's vertices tell is noise.
    """
    areas = vertex_areas(source) * shown
    resting = float((areas * static).sum() / max(areas.sum(), 1e-300))
    trust = float(np.clip((resting - _RESTING) / _RAMP, 0, 1))
    why = f"; held where it rests ({resting:.0%})" if trust > 0 else ""
    firm = _firmness(source, loops)
    if trust > 0 and blurred > 0:
        firm *= 1 + _CALMED * blurred * apart_share(source, static)
    return static * firm, trust, why


def _firmness(source: Mesh, pairs: Sequence[LoopPair]) -> FloatArray:
    """(n,) at least 1: bending would pull skin along that lies beside lids that close."""
    lids = [source.vertices[pair.vertices] for pair in pairs if pair.lid]
    if not lids:
        return np.ones(len(source.vertices))
    distance = KDTree(np.concatenate(lids)).query(source.vertices)[0]
    return 1 + (_FIRM - 1) * np.exp(-((distance / _BESIDE_LID) ** 2))
