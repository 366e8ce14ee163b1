"""From lists of corners to triangles, with the checks that every reader shares."""

from __future__ import annotations

import numpy as np

from engine.errors import MeshFormatError
from engine.io import _polygon_kernels as kernels
from engine.types import FloatArray, IntArray, Mesh, MeshWarning

NAMED_ELEMENTS = 100
NAMED_FIRST = 10
LARGEST_COORDINATE = 1e60  # its fourth power is still a double
MEMORY_PER_BYTE = 5
MEMORY_FLOOR = 32 << 20


def check_memory(size: int, **counts: int) -> None:
    """Refuse a file of ``size`` bytes whose ``counts`` of 8-byte numbers are out of proportion.

    No real mesh comes near: it spends more bytes on a corner than the few digits that a file
    made to exhaust memory does.
    """
    needed = 8 * sum(counts.values())
    if needed > MEMORY_PER_BYTE * size + MEMORY_FLOOR:
        raise MeshFormatError(
            f"the file's {size} bytes unpack to {needed}; a mesh of this size takes at most "
            f"{MEMORY_PER_BYTE} times its bytes and {MEMORY_FLOOR} more",
            code="out_of_proportion",
            elements={"bytes": size, "unpacked_bytes": needed},
        )


def outgrow_single(vertices: FloatArray) -> bool:
    """Whether 32-bit floats would round ``vertices`` by over 1e-6 of their extent: far from 0."""
    low, high = np.array([(column.min(), column.max()) for column in vertices.T]).T
    farthest = np.maximum(np.abs(low), np.abs(high)).max()
    return bool(farthest * np.finfo(np.float32).eps > 2e-6 * np.linalg.norm(high - low))


def check_finite(vertices: FloatArray) -> None:
    """Refuse coordinates that are NaN, infinite or absurdly far out, naming the vertices."""
    if vertices.min() >= -LARGEST_COORDINATE and vertices.max() <= LARGEST_COORDINATE:
        return
    bad = np.flatnonzero(~np.isfinite(vertices).all(axis=1))
    if not len(bad):
        far = np.flatnonzero((np.abs(vertices) > LARGEST_COORDINATE).any(axis=1))
        raise MeshFormatError(
            f"{len(far)} vertices have coordinates beyond {LARGEST_COORDINATE:g}, the first "
            f"is vertex {far[0]}",
            code="too_large",
            elements={"vertices": far[:NAMED_ELEMENTS].tolist(), "count": len(far)},
        )
    raise MeshFormatError(
        f"{len(bad)} vertices have NaN or infinite coordinates, the first is vertex {bad[0]}; "
        "remove them or give them positions",
        code="not_finite",
        elements={"vertices": bad[:NAMED_ELEMENTS].tolist(), "count": len(bad)},
    )


def check_corners(corners: IntArray, offsets: IntArray, vertex_count: int) -> None:
    """Refuse corners that name no vertex, naming the polygons."""
    if not len(corners) or (corners.min() >= 0 and corners.max() < vertex_count):
        return
    named = np.empty(NAMED_ELEMENTS, np.int64)
    count = kernels.bad_polygons(corners, offsets, vertex_count, named)
    named = named[:count]
    raise MeshFormatError(
        f"{count} faces refer to vertices that do not exist, the first is face "
        f"{named[0]}; the file has {vertex_count} vertices",
        code="index_out_of_range",
        elements={"faces": named.tolist(), "count": count, "vertex_count": vertex_count},
    )


def fan_triangles(corners: IntArray, offsets: IntArray, count: int, size: int) -> IntArray:
    """(count, 3) triangles of the polygons, each fanned from its first corner.

    Shares memory with ``corners`` when all polygons are triangles. ``size``: the file's bytes.
    """
    if 3 * count == len(corners) == 3 * (len(offsets) - 1):
        return corners.reshape(-1, 3)
    check_memory(size, faces=3 * count, corners=len(corners), offsets=2 * len(offsets))
    faces = np.empty((count, 3), np.int64)
    kernels.fan(corners, offsets, faces)
    return faces


def unrolled_strips(items: IntArray, offsets: IntArray, size: int) -> tuple[IntArray, IntArray]:
    """Corners and offsets of the triangles of strips. ``size``: the file's bytes."""
    count = kernels.unroll_strips(items, offsets, np.empty((0, 3), np.int64))
    check_memory(size, items=len(items), strips=len(offsets), triangles=4 * count)
    triangles = np.empty((count, 3), np.int64)
    kernels.unroll_strips(items, offsets, triangles)
    return triangles.reshape(-1), 3 * np.arange(count + 1)


def build_mesh(
    vertices: FloatArray, corners: IntArray, offsets: IntArray, size: int
) -> tuple[Mesh, tuple[MeshWarning, ...]]:
    """The checked mesh and what is unusual about its polygons and vertices."""
    if not len(vertices):
        raise MeshFormatError("the file has no vertices", code="no_vertices")
    check_finite(vertices)
    check_corners(corners, offsets, len(vertices))
    thin = np.empty(NAMED_FIRST, np.int64)
    triangles, thin_count = kernels.count_triangles(offsets, thin)
    if not triangles:
        raise MeshFormatError(
            f"the file has {len(vertices)} points and no faces; reconstruct a surface first",
            code="no_faces",
            elements={"vertex_count": len(vertices)},
        )
    faces = fan_triangles(corners, offsets, triangles, size)
    used = np.zeros(len(vertices), bool)
    used[corners] = True
    unused = np.empty(NAMED_FIRST, np.int64)
    unused_count = kernels.unused_vertices(used, unused)
    return Mesh(vertices, faces), (
        *_warning("degenerate_polygons", "faces have fewer than 3 corners", thin_count, thin),
        *_warning("unreferenced_vertices", "vertices belong to no face", unused_count, unused),
    )


def _warning(code: str, what: str, count: int, found: IntArray) -> tuple[MeshWarning, ...]:
    first = tuple(found[: min(count, NAMED_FIRST)].tolist())
    elements = what.split(maxsplit=1)[0]
    return (MeshWarning(code, f"{count} {what}", elements, count, first),) if count else ()
