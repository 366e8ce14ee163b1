"""Reading PLY: vertex positions and faces; every other element and property stays as bytes."""

from __future__ import annotations

import numpy as np

from engine.errors import MeshFormatError
from engine.io._mesh_file import MeshFile
from engine.io._ply_body import PlyBody, longer_rows_warning
from engine.io._ply_header import PlyElement, PlyHeader, parse_header
from engine.io._polygons import build_mesh, check_memory, outgrow_single, unrolled_strips
from engine.types import IntArray, MeshWarning

VERTEX_LISTS = ("vertex_indices", "vertex_index")
STRIPS = "tristrips"


def read_ply(data: bytes, begin: int) -> MeshFile:
    """The PLY file whose magic word is at byte ``begin``."""
    header = parse_header(data, begin)
    position = position_properties(header)
    index_of = _index_lists(header)
    body = PlyBody(data, header)
    body.check_size()
    at, warnings = header.body, list[MeshWarning]()
    vertices = np.empty((0, 3))
    polygons: list[tuple[IntArray, IntArray]] = []
    for element in header.elements:
        if element.name == "vertex":
            check_memory(len(data), vertices=3 * element.count)
            vertices, at, longer = body.scalars(element, at, position)
            warnings += longer_rows_warning(element, longer)
        elif element.name in index_of:
            offsets, items, at, longer = body.lists(element, at, index_of[element.name])
            if element.name == STRIPS:
                items, offsets = unrolled_strips(items, offsets, len(data))
            polygons.append((items, offsets))
            warnings += longer_rows_warning(element, longer)
        else:
            at = body.skip(element, at)
    corners, offsets = _joined(polygons)
    warnings += body.rest_warning(at)
    mesh, unusual = build_mesh(vertices, corners, offsets, len(data))
    element = header.element("vertex")
    scalars = {element.properties[i].scalar for i in position} if element else set[str]()
    return MeshFile(
        mesh=mesh,
        corners=corners,
        offsets=offsets,
        format="ply",
        double=bool(scalars & {"f8", "i4", "u4"}) or outgrow_single(vertices),
        warnings=(*warnings, *unusual),
        source=data,
        layout=header,
    )


def position_properties(header: PlyHeader) -> tuple[int, ...]:
    """Which properties of the vertex element are x, y and z."""
    element = header.element("vertex")
    if element is None:
        raise MeshFormatError("the PLY file has no vertex element", code="no_vertices")
    return _scalar_properties(element, "x", "y", "z", required=True)


def normal_properties(header: PlyHeader) -> tuple[int, ...]:
    """Which properties of the vertex element are nx, ny and nz; empty unless all three are."""
    element = header.element("vertex")
    return () if element is None else _scalar_properties(element, "nx", "ny", "nz", required=False)


def colour_properties(header: PlyHeader) -> tuple[int, ...]:
    """Which properties of the vertex element are red, green and blue; empty unless all three."""
    element = header.element("vertex")
    names = ("red", "green", "blue")
    return () if element is None else _scalar_properties(element, *names, required=False)


def _scalar_properties(element: PlyElement, *names: str, required: bool) -> tuple[int, ...]:
    found = [element.index(name) for name in names]
    usable = [i for i in found if i is not None and not element.properties[i].is_list]
    if len(usable) == len(names):
        return tuple(usable)
    if required:
        raise MeshFormatError(
            f"the PLY element 'vertex' lacks the scalar properties {', '.join(names)}",
            code="no_positions",
        )
    return ()


def _index_lists(header: PlyHeader) -> dict[str, int]:
    """Which property of faces, and of triangle strips, is the list of vertices."""
    found: dict[str, int] = {}
    for name in ("face", STRIPS):
        element = header.element(name)
        if element is None or not element.count:
            continue
        index = element.index(*VERTEX_LISTS)
        if index is None or not element.properties[index].is_list:
            raise MeshFormatError(
                f"the PLY element {name!r} lacks the list property vertex_indices", code="no_faces"
            )
        found[name] = index
    return found


def _joined(polygons: list[tuple[IntArray, IntArray]]) -> tuple[IntArray, IntArray]:
    """Corners and offsets of faces and strips as one."""
    if len(polygons) == 1:
        return polygons[0]
    corners, offsets = np.empty(0, np.int64), np.zeros(1, np.int64)
    for more, ends in polygons:
        offsets = np.concatenate([offsets, len(corners) + ends[1:]])
        corners = np.concatenate([corners, more])
    return corners, offsets
