"""Reading a mesh file of either format."""

from __future__ import annotations

from pathlib import Path

from engine.io._mesh_file import MeshFile
from engine.io._obj_reader import read_obj
from engine.io._ply_reader import read_ply
from engine.io._sniff import sniff


def read_mesh(source: bytes | Path) -> MeshFile:
    """Read a PLY or OBJ file; what it is decides its content, never its name.

    Vertices come in file order as float64, polygons fanned from their first corner. Raises
    UnsupportedFormatError for other formats and MeshFormatError, with the offending vertices,
    faces, line or byte, for files that are damaged or hold no surface.
    """
    data = source.read_bytes() if isinstance(source, Path) else source
    kind, begin = sniff(data)
    return read_obj(data, begin) if kind == "obj" else read_ply(data, begin)
