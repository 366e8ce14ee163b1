"""Skin: what is held in places of its own pulls its surroundings along, over a reach."""

from __future__ import annotations

from dataclasses import dataclass

import scipy.sparse as sp

from engine.restoration._elastic import Elastic
from engine.restoration._turned import Orientation
from engine.types import FloatArray, Mesh

_DAMPED = 2.0  # the least stretching for which a bump does not overshoot


def skin_weights(reach: float) -> dict[str, float]:
    """What bending and stretching weigh against places, for ``Elastic``'s energies."""
    return {"bend": reach**4, "stretch": _DAMPED * reach**2}


@dataclass(frozen=True, slots=True)
class HeldSkin:
    """A mesh whose vertices are held by ``stiffness`` (n, n), its lower half, and exact points.

    ``stretching`` is what resistance to stretching counts for in ``stiffness``; ``points`` (k, n)
    are the points that keep their places; ``rest`` (n, 3) is where faces count as undistorted.
    """

    mesh: Mesh
    orientation: Orientation
    stiffness: sp.csc_array
    stretching: float
    points: sp.csr_array
    rest: FloatArray

    @classmethod
    def of(cls, elastic: Elastic, reach: float, points: sp.csr_array, rest: FloatArray) -> HeldSkin:
        """An ``elastic`` mesh as skin that is pulled along over a ``reach``."""
        pattern = elastic.pattern
        data = elastic.stiffness(**skin_weights(reach), hold=elastic.areas)
        lower = sp.csc_array((data, pattern.indices, pattern.indptr), shape=(pattern.n, pattern.n))
        return cls(elastic.mesh, elastic.orientation, lower, reach**2, points, rest)
