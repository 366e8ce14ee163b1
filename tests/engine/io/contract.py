"""What holds of any bytes at all: they are refused by name, or read, edited and written well."""

from __future__ import annotations

import re

import numpy as np

from engine.errors import EngineError
from engine.io import MeshFile, read_mesh, write_mesh
from engine.io._mesh_file import ObjLayout
from engine.types import FloatArray

_WORD = re.compile(rb"\S+")


def check(data: bytes) -> MeshFile | None:
    """The file, None if it was refused; anything but an EngineError fails."""
    try:
        file = read_mesh(data)
    except EngineError as error:
        assert error.code and str(error)
        return None
    assert write_mesh(file) == data
    moved = shifted(file)
    try:
        written = write_mesh(file, moved)
    except EngineError as error:
        assert error.code == "not_representable"
        return file
    check_edit(file, moved, written)
    return file


def shifted(file: MeshFile) -> FloatArray:
    """Every second vertex elsewhere, by a little less than the mesh is large."""
    moved = file.mesh.vertices.copy()
    extent = np.ptp(moved, axis=0).max() or np.abs(moved).max() or 1.0
    moved[::2] += extent * np.array([0.37, -0.61, 0.83])
    return moved


def check_edit(file: MeshFile, moved: FloatArray, written: bytes) -> None:
    """``written`` differs from the file in the positions of what moved, and maybe normals."""
    again, old = read_mesh(written), file.mesh.vertices
    assert again.format == file.format
    assert np.array_equal(again.corners, file.corners)
    assert np.array_equal(again.offsets, file.offsets)
    assert [w.code for w in again.warnings] == [w.code for w in file.warnings]
    stay = moved == old
    assert np.array_equal(again.mesh.vertices[stay], old[stay])
    assert (np.abs(again.mesh.vertices - moved) <= tolerance(file, moved)).all()
    if isinstance(file.layout, ObjLayout) or file.layout.encoding == "ascii":
        assert _WORD.sub(b"", written) == _WORD.sub(b"", file.source)
        return
    body = file.layout.body
    assert len(written) == len(file.source)
    assert written[:body] == file.source[:body]


def tolerance(file: MeshFile, moved: FloatArray) -> FloatArray:
    """(3,) how far a written coordinate may be from the one that was asked for."""
    largest = np.abs(moved).max()
    size = float(np.linalg.norm(np.ptp(moved, axis=0))) or largest
    text = float(2e-7 * size + 4 * np.spacing(largest))
    if isinstance(file.layout, ObjLayout):
        return np.full(3, text)
    element = file.layout.element("vertex")
    assert element is not None
    kinds = [each.scalar for axis in "xyz" for each in element.properties if each.name == axis]
    rounding = {"f4": largest * 2.0**-23, "f8": 0.0}
    own = np.array([rounding.get(kind, 0.5 + 1e-9) for kind in kinds])
    return own + text if file.layout.encoding == "ascii" else own
