"""Clean OBJ and PLY of a mesh file: positions and polygons, nothing else."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from engine.io._mesh_file import MeshFile
from engine.types import FloatArray

_CHUNK = 100_000


def export_obj(file: MeshFile, vertices: FloatArray) -> bytes:
    """OBJ with the file's polygons of 3 and more corners in order, and ``vertices`` (n, 3)."""
    return b"".join([*_obj_vertices(vertices, file.double), *_obj_faces(file)])


def _obj_vertices(vertices: FloatArray, double: bool) -> Iterator[bytes]:
    line = b"v %a %a %a\n" if double else b"v %.9g %.9g %.9g\n"
    for start in range(0, len(vertices), _CHUNK):
        chunk = vertices[start : start + _CHUNK]
        yield line * len(chunk) % tuple(chunk.reshape(-1).tolist())


def _obj_faces(file: MeshFile) -> Iterator[bytes]:
    sizes = np.diff(file.offsets)
    lines = {int(size): b"f" + b" %d" * int(size) + b"\n" for size in np.unique(sizes)}
    lines = {size: line if size >= 3 else b"" for size, line in lines.items()}
    kept = np.repeat(sizes >= 3, sizes)
    for start in range(0, len(sizes), _CHUNK):
        stop = min(start + _CHUNK, len(sizes))
        corners = slice(file.offsets[start], file.offsets[stop])
        numbers = (file.corners[corners][kept[corners]] + 1).tolist()
        yield b"".join(lines[size] for size in sizes[start:stop].tolist()) % tuple(numbers)


def export_ply(file: MeshFile, vertices: FloatArray) -> bytes:
    """Little-endian PLY; positions are double where the file's are, lists hold the polygons."""
    scalar, name = ("<f8", "double") if file.double else ("<f4", "float")
    sizes = np.diff(file.offsets)
    counter = "uchar" if sizes.max(initial=0) < 256 else "int"
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(vertices)}\n"
        + "".join(f"property {name} {axis}\n" for axis in "xyz")
        + f"element face {len(sizes)}\nproperty list {counter} int vertex_indices\nend_header\n"
    )
    return header.encode() + vertices.astype(scalar).tobytes() + _ply_lists(file, counter)


def _ply_lists(file: MeshFile, counter: str) -> bytes:
    """The lists as one run of bytes: every length and every item written at its place."""
    sizes = np.diff(file.offsets)
    width = 1 if counter == "uchar" else 4
    out = np.empty(width * len(sizes) + 4 * len(file.corners), np.uint8)
    is_length = np.zeros(len(out), bool)
    starts = width * np.arange(len(sizes)) + 4 * file.offsets[:-1]
    is_length[starts[:, None] + np.arange(width)] = True
    out[is_length] = sizes.astype("<u1" if width == 1 else "<i4").view(np.uint8)
    out[~is_length] = file.corners.astype("<i4").view(np.uint8)
    return out.tobytes()
