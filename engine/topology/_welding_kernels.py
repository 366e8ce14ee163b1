"""Compiled search for rows of numbers that are there more than once."""

from __future__ import annotations

from engine._jit import kernel
from engine.types import BoolArray, IntArray


@kernel
def first_rows(rows: IntArray, alone: BoolArray, table: IntArray, first: IntArray) -> None:
    """``first[i]`` becomes the lowest row equal to row i; a row ``alone`` is equal to none.

    ``table`` is full of -1 and its size a power of 2 above n: an open-addressed hash table.
    """
    mask = len(table) - 1
    for i in range(len(rows)):
        mixed = 0
        for k in range(rows.shape[1]):
            mixed = (mixed ^ rows[i, k]) * -7046029254386353131
            mixed ^= (mixed >> 32) & 0xFFFFFFFF
        first[i] = i
        slot = mixed & mask
        while not alone[i] and table[slot] >= 0 and first[i] == i:
            other, same = table[slot], True
            for k in range(rows.shape[1]):
                same = same and rows[i, k] == rows[other, k]
            if same:
                first[i] = other
            slot = (slot + 1) & mask
        if not alone[i] and first[i] == i:
            table[slot] = i
