"""Compiled search for rows of numbers that are there more than once."""

from __future__ import annotations

from engine._jit import kernel
from engine.types import FloatArray, IntArray


@kernel
def first_rows(rows: FloatArray, bits: IntArray, table: IntArray, first: IntArray) -> None:
    """``first[i]`` becomes the lowest row equal to row i; a row with NaN is equal to none.

    ``bits`` are the bits of ``rows`` (n, c), which hold no -0. ``table`` is full of -1 and its
    size a power of 2 above n: an open-addressed hash table.
    """
    mask = len(table) - 1
    for i in range(len(rows)):
        mixed, proper = 0, True
        for k in range(rows.shape[1]):
            proper = proper and rows[i, k] == rows[i, k]
            mixed = (mixed ^ bits[i, k]) * -7046029254386353131
            mixed ^= (mixed >> 32) & 0xFFFFFFFF
        first[i] = i
        slot = mixed & mask
        while proper and table[slot] >= 0 and first[i] == i:
            other, same = table[slot], True
            for k in range(rows.shape[1]):
                same = same and bits[i, k] == bits[other, k]
            if same:
                first[i] = other
            slot = (slot + 1) & mask
        if proper and first[i] == i:
            table[slot] = i
