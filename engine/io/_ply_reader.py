"""Reading PLY: vertex positions and faces; every other element and property stays as bytes."""

from __future__ import annotations

import numpy as np

from engine.errors import MeshFormatError
from engine.io._mesh_file import MeshFile
from engine.io._ply_body import PlyBody, longer_rows_warning
from engine.io._ply_header import PlyElement, PlyHeader, parse_header
from engine.io._polygons import build_mesh, check_memory, outgrow_single
from engine.types import IntArray, MeshWarning

FACE_LISTS = ("vertex_indices", "vertex_index")


def read_ply(data: bytes, begin: int) -> MeshFile:
    """The PLY file whose magic word is at byte ``begin``."""
    header = parse_header(data, begin)
    position = position_properties(header)
    face_list = _face_list(header)
    body = PlyBody(data, header)
    body.check_size()
    at, warnings = header.body, list[MeshWarning]()
    vertices = np.empty((0, 3))
    corners: IntArray = np.empty(0, np.int64)
    offsets: IntArray = np.zeros(1, np.int64)
    for element in header.elements:
        if element.name == "vertex":
            check_memory(len(data), vertices=3 * element.count)
            vertices, at, longer = body.scalars(element, at, position)
            warnings += longer_rows_warning(element, longer)
        elif element.name == "face" and element.count:
            offsets, corners, at, longer = body.lists(element, at, face_list)
            warnings += longer_rows_warning(element, longer)
        else:
            at = body.skip(element, at)
    if header.encoding != "ascii" and at < len(data):
        message = f"{len(data) - at} bytes follow the last element"
        warnings.append(MeshWarning("trailing_bytes", message, "bytes", len(data) - at, (at,)))
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


def _face_list(header: PlyHeader) -> int:
    element = header.element("face")
    if element is None or not element.count:
        if header.element("tristrips") is not None:
            raise MeshFormatError(
                "the PLY file stores triangle strips; convert them to faces",
                code="triangle_strips",
            )
        return -1
    index = element.index(*FACE_LISTS)
    if index is None or not element.properties[index].is_list:
        raise MeshFormatError(
            "the PLY element 'face' lacks the list property vertex_indices", code="no_faces"
        )
    if element.properties[index].scalar.startswith("f"):
        raise MeshFormatError("PLY vertex indices must be integers", code="bad_header")
    return index
