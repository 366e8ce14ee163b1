"""Writing an edited mesh: into its own file, or as clean OBJ or PLY."""

from __future__ import annotations

from typing import Literal

from engine.io._export import export_obj, export_ply
from engine.io._mesh_file import MeshFile, ObjLayout
from engine.io._obj_patch import patch_obj
from engine.io._ply_patch import patch_ply
from engine.types import FloatArray


def write_mesh(
    file: MeshFile,
    vertices: FloatArray | None = None,
    *,
    format: Literal["source", "obj", "ply"] = "source",
) -> bytes:
    """The file with other ``vertices`` (n, 3), in file order; None stands for its own.

    ``"source"`` is the file that was read with the numbers that changed replaced, in its own
    number format: coordinates that stay keep their bytes, normals are renewed (area-weighted)
    where a vertex around them moved, and everything else is left alone. ``"obj"`` and ``"ply"``
    (binary, little endian) hold positions and polygons only. Raises MeshFormatError
    (``not_representable``) when the file's own number type cannot hold a position.
    """
    positions = file.positions(vertices)
    if format == "obj":
        return export_obj(file, positions)
    if format == "ply":
        return export_ply(file, positions)
    if isinstance(file.layout, ObjLayout):
        return patch_obj(file, file.layout, positions)
    return patch_ply(file, file.layout, positions)
