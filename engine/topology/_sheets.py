"""Which faces continue each other across an edge, how to turn them, and what is one piece."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import breadth_first_order

from engine.errors import TopologyError
from engine.topology._component_kernels import lowest_in_component, numbered
from engine.topology._halfedges import EqualRuns, edge_runs, origins
from engine.topology._sheets_kernels import best_pairs, face_areas, face_vectors
from engine.types import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Sheets:
    """Faces joined across edges: ``joints`` (j, 2) half-edges that meet.

    ``piece`` (m,) is the connected part that each face belongs to, ``area`` (m,) its area.

    Where an edge has three faces or more one pair is joined, listed in ``crowded`` (c, 2) too;
    ``surplus`` holds the half-edges that are left over there.
    """

    joints: IntArray
    surplus: IntArray
    crowded: IntArray
    piece: IntArray
    area: FloatArray

    @property
    def piece_area(self) -> FloatArray:
        """Area of each piece."""
        return _sums(self.piece, self.area)

    def only(self, inside: BoolArray) -> IntArray:
        """The joints between the faces ``inside``, in the numbering of these faces alone."""
        if inside.all():
            return self.joints
        joints = self.joints[inside[self.joints // 3].all(axis=1)]
        number = np.cumsum(inside) - 1
        return 3 * number[joints // 3] + joints % 3


def joined_sheets(vertices: FloatArray, faces: IntArray) -> Sheets:
    """Join faces across their edges; on a crowded edge the two sheets that belong together.

    These are the ones of the largest pieces (as joined by the other edges), then those that are
    turned alike, then those that bend least against each other, to single precision; last, those
    whose third corners come first by position.
    """
    runs = edge_runs(faces)
    first = runs.start[runs.size == 2]
    joints = np.stack([runs.order[first], runs.order[first + 1]], axis=1)
    area = face_areas(vertices, faces)
    piece = _pieces(len(faces), joints)
    crowded, owner = runs.members(runs.size > 2)
    surplus, chosen = crowded[:0], joints[:0]
    if len(crowded):
        normals = face_vectors(vertices, faces)
        apex = vertices[faces.reshape(-1)[crowded - crowded % 3 + (crowded + 2) % 3]]
        crowded = crowded[np.lexsort((*apex.T, owner))]
        area_of_piece = _sums(piece, area).astype(np.float32).astype(np.float64)
        ends = np.searchsorted(owner, np.arange(owner[-1] + 2))
        chosen = best_pairs(origins(faces), normals, area_of_piece[piece], crowded, ends)
        surplus = crowded[~np.isin(crowded, chosen)]
        joints = np.concatenate([joints, chosen])
        piece = _pieces(len(faces), joints)
    return Sheets(joints, surplus, chosen, piece, area)


def _sums(label: IntArray, values: FloatArray) -> FloatArray:
    return np.bincount(label, values).astype(np.float64)


def _pieces(face_count: int, joints: IntArray) -> IntArray:
    return numbered(lowest_in_component(face_count, joints[:, 0] // 3, joints[:, 1] // 3))[0]


def turned_faces(faces: IntArray, joints: IntArray, area: FloatArray) -> BoolArray:
    """Which faces of one connected piece to reverse so that all run alike.

    The smaller part by area is reversed. Raises ``TopologyError`` for a one-sided piece.
    """
    start = origins(faces)
    f, g = joints[:, 0] // 3, joints[:, 1] // 3
    against = start[joints[:, 0]] == start[joints[:, 1]]
    if not against.any():
        return np.zeros(len(faces), dtype=np.bool_)
    turned = _parity(len(faces), f, g, against)
    torn = (turned[f] ^ turned[g]) != against
    if torn.any():
        bad = np.unique(np.concatenate([f[torn], g[torn]]))
        raise TopologyError(
            f"the surface has only one side (a Möbius strip): going round it, {int(torn.sum())} "
            f"edges join a front to a back. Cut it open or delete the faces there",
            code="not_orientable",
            elements={"faces": bad[:100].tolist()},
        )
    return turned if area[turned].sum() <= area[~turned].sum() else ~turned


def _parity(count: int, f: IntArray, g: IntArray, against: BoolArray) -> BoolArray:
    """Turn of each face along a breadth-first tree of the joints."""
    pairs = EqualRuns.of(np.minimum(f, g) * np.int64(count) + np.maximum(f, g))
    one = pairs.order[pairs.start]
    links = sparse.csr_array((np.where(against[one], 2, 1), (f[one], g[one])), shape=(count, count))
    links = (links + links.T).tocsr()
    order, before = breadth_first_order(links, 0, directed=False)
    step = np.zeros(count, dtype=np.bool_)
    step[order[1:]] = np.asarray(links[before[order[1:]], order[1:]]).ravel() == 2
    depth_parity = step
    ancestor = np.where(before < 0, np.arange(count), before)
    while (ancestor[ancestor] != ancestor).any():
        depth_parity = depth_parity ^ depth_parity[ancestor]
        ancestor = ancestor[ancestor]
    return depth_parity
