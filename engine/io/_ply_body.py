"""The rows of a PLY body, whatever the encoding: places of properties, and values at places."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from engine.errors import MeshFormatError
from engine.io import _ply_kernels as kernels
from engine.io._ply_header import PlyElement, PlyHeader, PlyProperty
from engine.io._polygons import check_memory
from engine.io._text_kernels import read_numbers
from engine.io._text_numbers import as_bytes, format_error, line_numbers, resolve_numbers
from engine.types import FloatArray, IntArray, MeshWarning

CHUNK = 1 << 17


@dataclass(frozen=True, slots=True)
class PlyBody:
    """The bytes of a file together with its header."""

    data: bytes
    header: PlyHeader

    @property
    def ascii(self) -> bool:
        """Whether the rows are lines of text."""
        return self.header.encoding == "ascii"

    def check_size(self) -> None:
        """Refuse counts that the file is too short for, before anything is allocated."""
        at = self.header.body
        for element in self.header.elements:
            least = (
                2 * len(element.properties) if self.ascii else element.least_bytes
            ) * element.count
            if at + least > len(self.data) + self.ascii:
                raise MeshFormatError(
                    f"the header announces {element.count} rows of {element.name!r}, which take at "
                    f"least {least} bytes from byte {at} on; the file has {len(self.data)} bytes: "
                    "it is cut off or its header is wrong",
                    code="truncated",
                    elements={"byte": len(self.data), "element": element.name[:40]},
                )
            at += least

    def walk(
        self, element: PlyElement, at: int, rows: int, wanted: tuple[int, ...], first_row: int = 0
    ) -> tuple[IntArray, int, int]:
        """Places (rows, wanted) of properties in the rows from byte ``at`` on, the end of the
        last row, and how many rows of text hold more than declared."""
        places = np.empty((rows, len(wanted)), np.int64)
        columns = np.full(len(element.properties), -1, np.int64)
        columns[list(wanted)] = np.arange(len(wanted))
        counters = _sizes([each.counter for each in element.properties])
        if self.ascii:
            data = as_bytes(self.data)
            end, bad, longer, _ = kernels.walk_ascii(data, at, counters, columns, places)
        else:
            signs = np.array([_signed(each.counter) for each in element.properties], np.int64)
            sizes = _sizes([each.scalar for each in element.properties])
            end, bad = kernels.walk_binary(
                as_bytes(self.data),
                at,
                counters,
                signs,
                sizes,
                self.header.big_endian,
                columns,
                places,
            )
            longer = 0
        if bad >= 0:
            raise self._cut_off(element, first_row + bad, end)
        return places, end, longer

    def _cut_off(self, element: PlyElement, row: int, at: int) -> MeshFormatError:
        where = f"row {row} of {element.name!r} is incomplete or malformed"
        if self.ascii and at < len(self.data):
            return format_error(self.data, at, where, "bad_row")
        return MeshFormatError(
            f"{where}: the file ends at byte {len(self.data)} of what its header announces",
            code="truncated",
            elements={"byte": at, "row": row, "element": element.name[:40]},
        )

    def skip(self, element: PlyElement, at: int) -> int:
        """The end of the element whose rows start at ``at``; refuses incomplete rows."""
        if not element.properties:
            return at
        if not self.ascii and not any(each.is_list for each in element.properties):
            return at + element.least_bytes * element.count
        for row in range(0, element.count, CHUNK):
            _, at, _ = self.walk(element, at, min(CHUNK, element.count - row), (), row)
        return at

    def scalars(
        self, element: PlyElement, at: int, wanted: tuple[int, ...]
    ) -> tuple[FloatArray, int, int]:
        """Values (count, wanted) of scalar properties, the end of the element, longer rows."""
        values = np.empty((element.count, len(wanted)))
        longer = 0
        for row in range(0, element.count, CHUNK):
            rows = min(CHUNK, element.count - row)
            places, at, more = self.walk(element, at, rows, wanted, row)
            longer += more
            for column, index in enumerate(wanted):
                read = self.read(places[:, column], element.properties[index].scalar)
                if self.ascii and np.isnan(read).any():
                    resolve_numbers(self.data, np.ascontiguousarray(places[:, column]), read)
                values[row : row + rows, column] = read
        return values, at, longer

    def read(self, places: IntArray, scalar: str) -> FloatArray:
        """The numbers at ``places`` (k,); in text, NaN for what is no plain number."""
        places = np.ascontiguousarray(places)
        if self.ascii:
            values = np.empty(len(places))
            read_numbers(as_bytes(self.data), places, values)
            return values
        stored = np.dtype(scalar).newbyteorder(">" if self.header.big_endian else "<")
        raw = np.empty((len(places), stored.itemsize), np.uint8)
        kernels.gather_bytes(as_bytes(self.data), places, raw)
        with np.errstate(invalid="ignore"):  # signalling NaN
            return raw.view(stored)[:, 0].astype(np.float64)

    def lists(
        self, element: PlyElement, at: int, index: int
    ) -> tuple[IntArray, IntArray, int, int]:
        """Offsets (count + 1,) and items of a list of whole numbers, the end, longer rows."""
        check_memory(len(self.data), places=element.count, offsets=element.count)
        places, end, longer = self.walk(element, at, element.count, (index,))
        places, data = places[:, 0], as_bytes(self.data)
        offsets = np.zeros(element.count + 1, np.int64)
        listed, big = element.properties[index], self.header.big_endian
        counter, size = np.dtype(listed.counter).itemsize, np.dtype(listed.scalar).itemsize
        if self.ascii:
            kernels.ascii_list_ends(data, places, offsets)
        else:
            kernels.binary_list_ends(data, places, counter, _signed(listed.counter), big, offsets)
        total = int(offsets[-1])
        check_memory(len(self.data), places=element.count, offsets=element.count, corners=total)
        if listed.scalar.startswith("f"):
            return offsets, self._whole_numbers(listed, places, offsets), end, longer
        items = np.empty(total, np.int64)
        if self.ascii:
            bad = kernels.ascii_list_items(data, places, offsets, items)
            if bad >= 0:
                raise format_error(self.data, bad, "not a vertex number", "bad_face")
        else:
            signed = _signed(listed.scalar)
            kernels.binary_list_items(data, places, counter, size, signed, big, offsets, items)
        return offsets, items, end, longer

    def _whole_numbers(self, listed: PlyProperty, places: IntArray, offsets: IntArray) -> IntArray:
        """The items of the lists at ``places`` whose type is a fraction's, but not their values."""
        total = int(offsets[-1])
        check_memory(len(self.data), offsets=len(offsets), items=3 * total)
        starts = np.empty(total, np.int64)
        counter, size = np.dtype(listed.counter).itemsize, np.dtype(listed.scalar).itemsize
        kernels.list_item_places(
            as_bytes(self.data), places, self.ascii, counter, size, offsets, starts
        )
        values = self.read(starts, listed.scalar)
        with np.errstate(invalid="ignore"):
            items = values.astype(np.int64)
        bad = np.flatnonzero(items != values)
        if len(bad):
            polygon = int(np.searchsorted(offsets, bad[0], side="right")) - 1
            raise MeshFormatError(
                f"face {polygon} has a corner that is no whole number, at byte {starts[bad[0]]}",
                code="bad_face",
                elements={"faces": [polygon], "byte": int(starts[bad[0]])},
            )
        return items

    def rest_warning(self, at: int) -> tuple[MeshWarning, ...]:
        """What to say of bytes or lines from ``at`` on, after the last element."""
        if not self.ascii:
            count, what, first = len(self.data) - at, "bytes", (at,)
        else:
            count, what = kernels.count_lines(as_bytes(self.data), at), "lines"
            first = tuple(line_numbers(self.data, [at]))
        message = f"{count} {what} follow the last element that the header announces"
        return (MeshWarning(f"trailing_{what}", message, what, count, first),) if count else ()


def _signed(scalar: str | None) -> bool:
    return scalar is not None and scalar.startswith("i")


def _sizes(scalars: list[str | None] | list[str]) -> IntArray:
    return np.array([np.dtype(each).itemsize if each else 0 for each in scalars], np.int64)


def longer_rows_warning(element: PlyElement, count: int) -> tuple[MeshWarning, ...]:
    """What to say of ``count`` rows of text that hold more than the header declares."""
    if not count:
        return ()
    message = f"{count} rows of {element.name!r} hold more than the header declares"
    return (MeshWarning("longer_rows", message, "lines", count),)
