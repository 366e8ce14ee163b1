"""Small faces for edits that take seconds, and files of any make to hold them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from engine.io import read_mesh
from engine.types import FloatArray, IntArray, Mesh
from tests.engine.remeshed import coarser
from tests.faces import ICT_NEUTRAL

SMALL = 1500


@cache
def small(path: Path = ICT_NEUTRAL, count: int = SMALL) -> Mesh:
    """An ICT face on fewer of its vertices; the same ones in every expression."""
    rest, kept = coarser(read_mesh(ICT_NEUTRAL).mesh, count)
    return rest.moved(read_mesh(path).mesh.vertices[kept])


def rows(count: int, **columns: tuple[str, object]) -> NDArray[np.void]:
    """A table for ``ply``: name = (dtype, values)."""
    table = np.empty(count, dtype=[(name, dtype) for name, (dtype, _) in columns.items()])
    for name, (_, values) in columns.items():
        table[name] = values
    return table


_WORDS = {"f4": "float", "f8": "double", "u1": "uchar", "i4": "int", "u4": "uint", "u2": "ushort"}


def ply(
    vertices: FloatArray,
    faces: IntArray,
    *,
    real: str = "f4",
    order: str = "<",
    extra: Mapping[str, tuple[str, object]] | None = None,
) -> bytes:
    """A binary PLY file; ``extra`` vertex properties come after the coordinates."""
    coordinates = {axis: (order + real, vertices[:, i]) for i, axis in enumerate("xyz")}
    others = {name: (order + kind, values) for name, (kind, values) in (extra or {}).items()}
    points = rows(len(vertices), **coordinates, **others)
    polygons = np.empty(len(faces), dtype=[("n", "u1"), ("v", f"{order}i4", faces.shape[1:])])
    polygons["n"], polygons["v"] = faces.shape[1] if faces.ndim == 2 else 0, faces
    kinds = dict.fromkeys("xyz", real) | {n: kind for n, (kind, _) in (extra or {}).items()}
    header = [
        "ply",
        f"format binary_{'little' if order == '<' else 'big'}_endian 1.0",
        "comment a cut-out of ICT FaceKit",
        f"element vertex {len(vertices)}",
        *(f"property {_WORDS[kind]} {name}" for name, kind in kinds.items()),
        f"element face {len(faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    return "\n".join(header).encode() + points.tobytes() + polygons.tobytes()


def obj(vertices: FloatArray, polygons: Sequence[Sequence[int]]) -> bytes:
    """A plain OBJ file; ``polygons`` count vertices from 0."""
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in vertices]
    lines += ["f " + " ".join(str(1 + corner) for corner in polygon) for polygon in polygons]
    return "\n".join([*lines, ""]).encode()
