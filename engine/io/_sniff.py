"""Which format bytes are in, by their content alone."""

from __future__ import annotations

import codecs
from typing import Literal

from engine.errors import MeshFormatError, UnsupportedFormatError

_AS_UTF8 = "save it as UTF-8 or plain ASCII"
_SIGNATURES = (
    (codecs.BOM_UTF16_LE, "UTF-16 text", _AS_UTF8),
    (codecs.BOM_UTF16_BE, "UTF-16 text", _AS_UTF8),
    (b"\x1f\x8b", "gzip-compressed", "send it unpacked"),
    (b"BZh", "bzip2-compressed", "send it unpacked"),
    (b"\xfd7zXZ", "xz-compressed", "send it unpacked"),
    (b"PK\x03\x04", "a ZIP archive (or 3MF, USDZ)", "send the PLY or OBJ file itself"),
    (b"glTF", "GLB", "convert it to PLY or OBJ"),
    (b"Kaydara FBX", "FBX", "convert it to PLY or OBJ"),
    (b"; FBX", "FBX", "convert it to PLY or OBJ"),
    (b"BLENDER", "a Blender file", "export it as PLY or OBJ"),
    (b"solid ", "STL", "convert it to PLY or OBJ"),
    (b"OFF", "OFF", "convert it to PLY or OBJ"),
    (b"# vtk", "VTK", "convert it to PLY or OBJ"),
    (b"#VRML", "VRML", "convert it to PLY or OBJ"),
    (b"\x89PNG", "a PNG picture", "send a mesh"),
    (b"\xff\xd8\xff", "a JPEG picture", "send a mesh"),
    (b"%PDF", "PDF", "send a mesh"),
    (b"{", "JSON (or glTF)", "convert it to PLY or OBJ"),
    (b"<", "XML or HTML", "convert it to PLY or OBJ"),
)


def sniff(data: bytes) -> tuple[Literal["obj", "ply"], int]:
    """The format and where it starts (after a UTF-8 byte order mark).

    Everything that is neither PLY nor known to be something else is taken for OBJ, which has
    no signature. Raises UnsupportedFormatError naming what the bytes are instead.
    """
    if not data:
        raise MeshFormatError("the file is empty", code="empty")
    begin = 3 if data.startswith(codecs.BOM_UTF8) else 0
    if _is_wide_text(data[:64]):
        raise _unsupported("UTF-16 text", _AS_UTF8)
    if data[begin : begin + 4] in (b"ply\n", b"ply\r"):
        return "ply", begin
    for signature, name, advice in _SIGNATURES:
        if data.startswith(signature, begin):
            raise _unsupported(name, advice)
    return "obj", begin


def _is_wide_text(start: bytes) -> bool:
    """Whether every other byte is NUL and the others are ASCII: UTF-16 without its mark."""
    for zeros, letters in ((start[::2], start[1::2]), (start[1::2], start[::2])):
        if letters and not any(zeros) and all(9 <= letter < 127 for letter in letters):
            return len(start) >= 4
    return False


def _unsupported(name: str, advice: str) -> UnsupportedFormatError:
    return UnsupportedFormatError(
        f"the file is {name}, not PLY or OBJ: {advice}", elements={"found": name}
    )
