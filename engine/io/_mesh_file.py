"""A mesh file that was read: its triangles, its polygons, and the bytes to patch."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from engine.errors import EngineError
from engine.io._ply_header import PlyHeader
from engine.types import FloatArray, IntArray, Mesh, MeshWarning, frozen_array


@dataclass(frozen=True, slots=True)
class ObjLayout:
    """Where an OBJ file keeps its numbers.

    ``vertex_lines`` (n,) and ``normal_lines`` (k,) are byte offsets of the ``v`` and ``vn``
    statements; ``corner_normals`` (c,) is the normal of each polygon corner, -1 without one, or
    empty if the file has no normals.
    """

    vertex_lines: IntArray
    normal_lines: IntArray
    corner_normals: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class MeshFile:
    """A PLY or OBJ file.

    ``mesh``: the file's vertices in file order, its polygons fanned from their first corner.
    ``corners`` (c,) lists the vertices of all polygons one after the other, polygon i has
    ``corners[offsets[i]:offsets[i + 1]]``; ``offsets`` is (p + 1,). ``source`` holds the file's
    own bytes, ``layout`` where its numbers are. ``double`` says whether the file's positions
    carry more digits than a 32-bit float.
    """

    mesh: Mesh
    corners: IntArray
    offsets: IntArray
    format: Literal["obj", "ply"]
    double: bool
    warnings: tuple[MeshWarning, ...]
    source: bytes = field(repr=False)
    layout: ObjLayout | PlyHeader = field(repr=False)

    @property
    def polygon_count(self) -> int:
        """The number of polygons in the file, those with fewer than 3 corners included."""
        return len(self.offsets) - 1

    @property
    def polygon_of(self) -> IntArray:
        """(m,) the polygon of each triangle of ``mesh``."""
        triangles = np.maximum(np.diff(self.offsets) - 2, 0)
        return frozen_array(np.repeat(np.arange(len(triangles)), triangles), np.int64)

    @property
    def first_face(self) -> IntArray:
        """(p,) the first triangle of each polygon, -1 for one with fewer than 3 corners."""
        triangles = np.maximum(np.diff(self.offsets) - 2, 0)
        first = np.cumsum(triangles) - triangles
        first[triangles == 0] = -1
        return frozen_array(first, np.int64)

    def positions(self, vertices: FloatArray | None) -> FloatArray:
        """``vertices`` checked against the file's own, which None stands for."""
        if vertices is None:
            return self.mesh.vertices
        if vertices.shape != self.mesh.vertices.shape:
            raise EngineError(
                f"positions must be {self.mesh.vertices.shape}, not {vertices.shape}", code="shape"
            )
        return self.mesh.moved(vertices).vertices
