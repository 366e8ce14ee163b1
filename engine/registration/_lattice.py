"""Which sample is near: a lattice of cells that answers roughly and at once."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import distance_transform_edt

from engine.registration._poses_kernels import Lattice
from engine.types import FloatArray

_MOST_CELLS = 400_000
_FEW = 0.01  # share of the samples that may lie outside on each side


def lattice_of(points: FloatArray, cell: float, margin: float) -> Lattice:
    """The nearest of ``points`` (k, 3) for each cell of their box, ``margin`` wide around it.

    Cells grow where a few points far away would make too many.
    """
    low = np.quantile(points, _FEW, axis=0) - margin
    extent = np.quantile(points, 1 - _FEW, axis=0) + margin - low
    cell = max(cell, float(np.cbrt(extent.prod() / _MOST_CELLS)))
    shape = np.ceil(extent / cell).astype(np.int64)
    place = np.floor((points - low) / cell).astype(np.int64)
    inside = np.flatnonzero(((place >= 0) & (place < shape)).all(axis=1))[::-1]
    first = np.full(shape, -1)
    first[tuple(place[inside].T)] = inside
    nearest = np.zeros((3, *shape), dtype=np.int32)
    distance_transform_edt(first < 0, return_distances=False, return_indices=True, indices=nearest)
    return low, cell, shape, first[tuple(nearest)].ravel()
