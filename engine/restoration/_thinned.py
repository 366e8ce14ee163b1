"""Contact on dense meshes, looked for and undone on a coarser mesh over some of the vertices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from engine.decimation import decimate
from engine.nearest import NormalAwareIndex, vertex_stars
from engine.operators import Rings, vertex_normals
from engine.restoration._contact import Contacts
from engine.topology import boundary_loops
from engine.types import FloatArray, Mesh

_COUNT = 40_000  # vertices: closer than the details of a displacement that parts
_SEARCH_WEIGHT = 0.02  # of normals, where vertices are looked up on the coarser mesh
_SMOOTHED = 2.7  # rounds over each vertex's ring, for each vertex that stands for one
_PASSES = 2  # of parting, for smoothing takes something away


class ThinnedContacts:
    """``Contacts`` of some of a mesh's vertices, which the others follow smoothly."""

    def __init__(
        self, mesh: Mesh, shapes: Sequence[FloatArray], moves: FloatArray, rings: Rings
    ) -> None:
        n = len(mesh.vertices)
        self._kept, faces = decimate(mesh, boundary_loops(mesh.faces, n), _COUNT)
        coarse = Mesh(mesh.vertices[self._kept], faces)
        index = NormalAwareIndex(coarse, _SEARCH_WEIGHT, vertex_stars(faces, len(self._kept)))
        feet = index.feet(mesh.vertices, vertex_normals(mesh))
        self._corners, self._shares = faces[feet.face], feet.barycentric
        self._contacts = Contacts(coarse, [x[self._kept] for x in shapes], moves[self._kept])
        self._rings, self._rounds = rings, round(_SMOOTHED * n / len(self._kept))
        self._around = np.diff(rings.start)[:, None] + 1.0

    def parted(self, shape: FloatArray, within: FloatArray) -> FloatArray:
        """``shape`` (n, 3) with gaps nearly as ``Contacts.parted`` leaves them."""
        some = within[self._kept]
        for _ in range(_PASSES):
            change = self._contacts.parted(shape[self._kept], some) - shape[self._kept]
            if not change.any():
                break
            shape = shape + self._everywhere(change)
        return shape

    def depths(self, shape: FloatArray, within: FloatArray) -> FloatArray:
        """As ``Contacts.depths``, of the pairs on the coarser mesh."""
        return self._contacts.depths(shape[self._kept], within[self._kept])

    def _everywhere(self, change: FloatArray) -> FloatArray:
        out = np.einsum("ni,nia->na", self._shares, change[self._corners])
        for _ in range(self._rounds):
            out = self._rings.sums(out) / self._around
        return out
