"""Closing a hole with triangles that make no edge twice."""

from __future__ import annotations

import numpy as np

from engine.errors import TopologyError
from engine.topology._filling_kernels import dividing_chord, minimal_triangulation
from engine.topology._halfedges import origins, targets
from engine.types import FloatArray, IntArray

EXACT_CORNERS = 128
"""Holes with more corners are divided by short chords before the O(k^3) programme runs."""

COMPACTNESS = 0.01
"""Weight of squared sides against area: decides between triangulations of a flat hole."""

CHORD_ENDS = 2000


class HoleFiller:
    """Fills holes of one mesh one after the other, remembering every edge that exists."""

    def __init__(self, vertices: FloatArray, faces: IntArray, loops: list[IntArray]) -> None:
        self._points = vertices
        self._count = len(vertices)
        on_rim = np.zeros(len(vertices), dtype=np.bool_)
        for loop in loops:
            on_rim[loop] = True
        a, b = origins(faces), targets(faces)
        both = on_rim[a] & on_rim[b]
        self._edges = set(self._keys(a[both], b[both]).tolist())

    def fill(self, loop: IntArray) -> IntArray:
        """Faces (., 3) that close ``loop``, which runs with the surface on its left.

        On a surface without handles a triangulation that makes no edge twice always exists: the
        other edges between the corners cannot cross each other, so some corner has none of them.
        Raises ``TopologyError`` if there is none.
        """
        parts: list[IntArray] = []
        pending = [loop[::-1]]
        while pending:
            ring = pending.pop()
            if len(ring) == 3:
                parts.append(ring[None, :])
            elif len(ring) > EXACT_CORNERS:
                pending += self._divided(ring)
            else:
                parts.append(self._exact(ring))
        return np.concatenate(parts)

    def _keys(self, a: IntArray, b: IntArray) -> IntArray:
        return np.minimum(a, b) * np.int64(self._count) + np.maximum(a, b)

    def _forbidden(self, ring: IntArray) -> IntArray:
        """Existing edges between corners that are not neighbours, as sorted i k + j, i < j."""
        place = np.full(self._count, -1, dtype=np.int64)
        place[ring] = np.arange(len(ring))
        known = np.fromiter(self._edges, dtype=np.int64, count=len(self._edges))
        i, j = place[known // self._count], place[known % self._count]
        low, high = np.minimum(i, j), np.maximum(i, j)
        chord = (low >= 0) & (high - low > 1) & (high - low < len(ring) - 1)
        return np.sort(low[chord] * len(ring) + high[chord])

    def _exact(self, ring: IntArray) -> IntArray:
        k = len(ring)
        forbidden = np.zeros((k, k), dtype=np.bool_)
        forbidden.reshape(-1)[self._forbidden(ring)] = True
        points = self._points[ring] - self._points[ring].mean(axis=0)
        triangles, cost = minimal_triangulation(points, forbidden, COMPACTNESS)
        if not np.isfinite(cost):
            raise _crowded(ring)
        faces = ring[triangles]
        self._edges.update(self._keys(origins(faces), targets(faces)).tolist())
        return faces

    def _divided(self, ring: IntArray) -> list[IntArray]:
        stride = -(-len(ring) // CHORD_ENDS)
        i, j = dividing_chord(self._points[ring], self._forbidden(ring), stride)
        if i < 0:
            raise _crowded(ring)
        self._edges.add(int(self._keys(ring[i : i + 1], ring[j : j + 1])[0]))
        return [ring[i : j + 1], np.concatenate([ring[j:], ring[: i + 1]])]


def _crowded(ring: IntArray) -> TopologyError:
    return TopologyError(
        f"a hole of {len(ring)} corners cannot be closed: edges between its corners exist already",
        code="hole",
        elements={"vertices": ring[:100].tolist()},
    )
