"""Control points inside faces become vertices of the plane's triangulation.

A point strictly inside a face splits it in three, one near an edge splits the two faces there in
four. The plane map on the original triangulation is the restriction to its vertices.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.types import ComplexArray, IntArray, SurfacePoints, frozen_array

NEAR_VERTEX = 1e-9
NEAR_EDGE = 0.02


@dataclass(frozen=True, slots=True)
class RefinedPlane:
    """A plane triangulation with points inserted: ``vertices`` (k,) are the points' indices."""

    z: ComplexArray
    faces: IntArray
    vertices: IntArray

    def __post_init__(self) -> None:
        object.__setattr__(self, "z", frozen_array(self.z, np.complex128))
        object.__setattr__(self, "faces", frozen_array(self.faces, np.int64))
        object.__setattr__(self, "vertices", frozen_array(self.vertices, np.int64))


def insert_points(z: ComplexArray, faces: IntArray, points: SurfacePoints) -> RefinedPlane:
    """Insert ``points`` into the fold-free plane mesh ``z``, ``faces``; those at vertices stay."""
    weights = points.barycentric
    if (weights >= 1.0 - NEAR_VERTEX).any(axis=1).all():
        return RefinedPlane(z, faces, faces[points.face, np.argmax(weights, axis=1)])
    work = _Triangulation(z, faces)
    vertices = [
        work.insert(int(face), weights)
        for face, weights in zip(points.face, points.barycentric, strict=True)
    ]
    return RefinedPlane(
        np.asarray(work.z, dtype=np.complex128),
        np.asarray(work.faces, dtype=np.int64).reshape(-1, 3)[np.asarray(work.alive, dtype=bool)],
        np.asarray(vertices, dtype=np.int64),
    )


def _weights(z: list[complex], corners: list[int], point: complex) -> list[float]:
    a, b, c = (z[v] for v in corners)
    areas = [((u - point).conjugate() * (v - point)).imag for u, v in ((b, c), (c, a), (a, b))]
    total = sum(areas)
    return [area / total for area in areas]


class _Triangulation:
    """A growing triangulation: faces that were split stay listed, not ``alive``, with children."""

    def __init__(self, z: ComplexArray, faces: IntArray) -> None:
        self.z: list[complex] = z.tolist()
        self.faces: list[list[int]] = faces.tolist()
        self.alive = [True] * len(self.faces)
        self.children: dict[int, list[int]] = {}
        self.opposite: dict[tuple[int, int], int] = {
            (corners[i], corners[(i + 1) % 3]): face
            for face, corners in enumerate(self.faces)
            for i in range(3)
        }

    def insert(self, face: int, weights: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> int:
        corners = self.faces[face]
        top = int(np.argmax(weights))
        if weights[top] >= 1.0 - NEAR_VERTEX:
            return corners[top]
        point = sum(float(w) * self.z[v] for w, v in zip(weights, corners, strict=True))
        face, here = self._find(face, point)
        corners = self.faces[face]
        top = int(np.argmax(here))
        if here[top] >= 1.0 - NEAR_VERTEX:
            return corners[top]
        self.z.append(point)
        low = int(np.argmin(here))
        a, b = corners[(low + 1) % 3], corners[(low + 2) % 3]
        neighbour = self.opposite.get((b, a)) if here[low] < NEAR_EDGE else None
        if neighbour is None or not self._split_edge(face, neighbour, a, b):
            self._replace([face], [[corners[i], corners[(i + 1) % 3]] for i in range(3)])
        return len(self.z) - 1

    def _find(self, face: int, point: complex) -> tuple[int, list[float]]:
        """The living descendant of ``face`` that holds ``point``, and the weights there."""
        while face in self.children:
            face = max(
                self.children[face], key=lambda f: min(_weights(self.z, self.faces[f], point))
            )
        return face, _weights(self.z, self.faces[face], point)

    def _split_edge(self, face: int, neighbour: int, a: int, b: int) -> bool:
        """Split the two faces at the edge a-b in four, if that leaves all of them positive."""
        x = next(v for v in self.faces[face] if v not in {a, b})
        y = next(v for v in self.faces[neighbour] if v not in {a, b})
        rim = [[x, a], [b, x], [y, b], [a, y]]
        point = self.z[-1]
        if any(((self.z[u] - point).conjugate() * (self.z[v] - point)).imag <= 0.0 for u, v in rim):
            return False
        self._replace([face, neighbour], rim)
        return True

    def _replace(self, old: list[int], rim: list[list[int]]) -> None:
        """Fan the new last vertex to the directed ``rim`` edges in place of the ``old`` faces."""
        vertex = len(self.z) - 1
        fresh: list[int] = []
        for u, v in rim:
            index = len(self.faces)
            self.faces.append([u, v, vertex])
            self.alive.append(True)
            self.opposite.update({(u, v): index, (v, vertex): index, (vertex, u): index})
            fresh.append(index)
        for face in old:
            self.alive[face] = False
            self.children[face] = fresh
