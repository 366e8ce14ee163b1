"""The PLY header: encoding, elements, properties, and where the body starts."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from typing import Literal

import numpy as np

from engine.errors import MeshFormatError

Encoding = Literal["ascii", "binary_little_endian", "binary_big_endian"]

_LONGEST_HEADER = 1 << 20
_SCALARS = {
    **dict.fromkeys((b"char", b"int8"), "i1"),
    **dict.fromkeys((b"uchar", b"uint8"), "u1"),
    **dict.fromkeys((b"short", b"int16"), "i2"),
    **dict.fromkeys((b"ushort", b"uint16"), "u2"),
    **dict.fromkeys((b"int", b"int32"), "i4"),
    **dict.fromkeys((b"uint", b"uint32"), "u4"),
    **dict.fromkeys((b"float", b"float32"), "f4"),
    **dict.fromkeys((b"double", b"float64"), "f8"),
}
_ENCODINGS: dict[bytes, Encoding] = {
    b"ascii": "ascii",
    b"binary_little_endian": "binary_little_endian",
    b"binary_big_endian": "binary_big_endian",
}


@dataclass(frozen=True, slots=True)
class PlyProperty:
    """A property: numpy ``scalar`` code, and ``counter`` code when it is a list of such."""

    name: str
    scalar: str
    counter: str | None = None

    @property
    def is_list(self) -> bool:
        """Whether each row holds a list of scalars, its length first."""
        return self.counter is not None


@dataclass(frozen=True, slots=True)
class PlyElement:
    """``count`` rows of ``properties``."""

    name: str
    count: int
    properties: tuple[PlyProperty, ...]

    def index(self, *names: str) -> int | None:
        """Which property has one of ``names``, if there is one."""
        for i, each in enumerate(self.properties):
            if each.name in names:
                return i
        return None

    @property
    def least_bytes(self) -> int:
        """The fewest bytes that a binary row takes: every list empty."""
        return sum(np.dtype(each.counter or each.scalar).itemsize for each in self.properties)


@dataclass(frozen=True, slots=True)
class PlyHeader:
    """A parsed header; the first row is at byte ``body``."""

    encoding: Encoding
    elements: tuple[PlyElement, ...]
    body: int

    @property
    def big_endian(self) -> bool:
        """Whether binary numbers have their most significant byte first."""
        return self.encoding == "binary_big_endian"

    def element(self, name: str) -> PlyElement | None:
        """The element called ``name``, if there is one."""
        return next((each for each in self.elements if each.name == name), None)


def _bad(line: int, what: str, code: str = "bad_header") -> MeshFormatError:
    return MeshFormatError(f"PLY header, line {line}: {what}", code=code, elements={"line": line})


def _shown(word: bytes) -> str:
    return repr(word[:40].decode("ascii", "replace"))


def _parse_property(words: list[bytes], line: int) -> PlyProperty:
    if len(words) == 5 and words[1] == b"list":
        counter, scalar = _SCALARS.get(words[2]), _SCALARS.get(words[3])
        if counter is None or counter.startswith("f"):
            raise _bad(line, f"the length of a list cannot be {_shown(words[2])}")
    elif len(words) == 3:
        counter, scalar = None, _SCALARS.get(words[1])
    else:
        raise _bad(line, "a property is 'property type name' or 'property list type type name'")
    if scalar is None:
        raise _bad(line, f"unknown type {_shown(words[-2])}")
    return PlyProperty(words[-1].decode("utf-8", "replace"), scalar, counter)


def _header_lines(data: bytes, begin: int) -> tuple[list[bytes], int]:
    """The lines after ``ply`` up to end_header, and where the body starts."""
    newline = b"\n"
    if data[begin + 3 : begin + 5] == b"\r\n":
        newline = b"\r\n"
    elif data[begin + 3 : begin + 4] == b"\r":
        newline = b"\r"
    end = re.compile(rb"[\r\n]end_header[ \t]*(\r\n|\n|\r|$)").search(
        data, begin, begin + _LONGEST_HEADER
    )
    if end is None:
        raise MeshFormatError("the PLY header has no end_header line", code="bad_header")
    body = end.end()
    if newline == b"\r" and end.group(1) == b"\r\n":
        body -= 1
    return re.split(rb"\r\n|\n|\r", data[begin : end.start()])[1:], body


def parse_header(data: bytes, begin: int) -> PlyHeader:
    """The header at byte ``begin``; raises MeshFormatError with the line that is wrong."""
    lines, body = _header_lines(data, begin)
    encoding: Encoding | None = None
    elements: list[tuple[str, int, list[PlyProperty]]] = []
    for number, text in enumerate(lines, start=2):
        words = text.split()
        if not words or words[0] in (b"comment", b"obj_info"):
            continue
        if words[0] == b"format":
            encoding = _ENCODINGS.get(words[1]) if len(words) >= 2 else None
            if encoding is None:
                raise _bad(number, "the format must be ascii, binary_little_endian or ..._big_...")
        elif words[0] == b"element":
            if len(words) != 3 or not re.fullmatch(rb"\d{1,18}", words[2]):
                raise _bad(number, "an element is 'element name count'")
            elements.append((words[1].decode("utf-8", "replace"), int(words[2]), []))
        elif words[0] == b"property" and elements:
            elements[-1][2].append(_parse_property(words, number))
        else:
            raise _bad(number, f"{_shown(words[0])} is not expected here")
    if encoding is None:
        raise MeshFormatError("the PLY header has no format line", code="bad_header")
    _check_names([name for name, _, _ in elements])
    for _, _, properties in elements:
        _check_names([each.name for each in properties])
    built = (PlyElement(name, count, tuple(properties)) for name, count, properties in elements)
    return PlyHeader(encoding, tuple(built), body)


def _check_names(names: list[str]) -> None:
    twice = sorted(name for name, count in Counter(names).items() if count > 1)
    if twice:
        raise MeshFormatError(
            f"the PLY header names {twice[0][:40]!r} twice",
            code="bad_header",
            elements={"names": [name[:40] for name in twice[:10]]},
        )
