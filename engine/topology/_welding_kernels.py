"""Compiled search for rows of numbers that are there more than once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from engine._jit import kernel
from engine.types import BoolArray, IntArray

PROPER, DEGENERATE, REPEATED, COINCIDENT = 0, 1, 2, 3


@kernel
def mix(mixed: int, value: int) -> int:
    """A hash of ``value`` and of what went before."""
    mixed = (mixed ^ value) * -7046029254386353131
    return mixed ^ ((mixed >> 32) & 0xFFFFFFFF)


@kernel
def unsigned_zero(bits: int) -> int:
    """The bits of a double, those of 0 for -0."""
    return 0 if bits == -0x8000000000000000 else bits


@kernel
def first_rows(rows: IntArray, alone: BoolArray, table: NDArray[np.int32], first: IntArray) -> None:
    """``first[i]`` becomes the lowest row equal to row i; a row ``alone`` is equal to none.

    ``rows`` are the bits of doubles; -0 equals 0. ``table`` is full of -1 and
    its size a power of 2 above n: an open-addressed hash table.
    """
    mask = len(table) - 1
    for i in range(len(rows)):
        mixed = 0
        for k in range(rows.shape[1]):
            mixed = mix(mixed, unsigned_zero(rows[i, k]))
        first[i] = i
        slot = mixed & mask
        while not alone[i] and table[slot] >= 0 and first[i] == i:
            other, same = table[slot], True
            for k in range(rows.shape[1]):
                same = same and unsigned_zero(rows[i, k]) == unsigned_zero(rows[other, k])
            if same:
                first[i] = other
            slot = (slot + 1) & mask
        if not alone[i] and first[i] == i:
            table[slot] = i


@kernel
def sorted_corners(faces: IntArray, position: IntArray, face: int) -> tuple[int, int, int]:
    """Where the face's corners are, the lowest first."""
    a, b, c = position[faces[face, 0]], position[faces[face, 1]], position[faces[face, 2]]
    low, high = min(a, b, c), max(a, b, c)
    return int(low), int(a + b + c - low - high), int(high)


@kernel
def same_corners(faces: IntArray, face: int, other: int) -> bool:
    """Whether two faces have the same vertices, in any order."""
    same = True
    for k in range(3):
        same = same and faces[face, k] in (faces[other, 0], faces[other, 1], faces[other, 2])
    return same


@kernel
def classify_faces(
    faces: IntArray,
    position: IntArray,
    table: NDArray[np.int32],
    kinds: NDArray[np.uint8],
    like: NDArray[np.int32],
) -> None:
    """``kinds[f]`` becomes PROPER, DEGENERATE (two corners at one place), REPEATED or COINCIDENT.

    A face is repeated that has the corners of one before it, in any order; coincident, if these
    are other vertices at the same places. ``like[f]`` is the first of them. ``table`` as in
    ``first_rows``.
    """
    mask = len(table) - 1
    for face in range(len(faces)):
        corners = sorted_corners(faces, position, face)
        kinds[face], like[face] = PROPER, face
        if corners[0] == corners[1] or corners[1] == corners[2]:
            kinds[face] = DEGENERATE
            continue
        slot = mix(mix(mix(0, corners[0]), corners[1]), corners[2]) & mask
        while table[slot] >= 0 and kinds[face] == PROPER:
            if sorted_corners(faces, position, table[slot]) == corners:
                like[face] = table[slot]
                kinds[face] = REPEATED if same_corners(faces, face, table[slot]) else COINCIDENT
            slot = (slot + 1) & mask
        if kinds[face] == PROPER:
            table[slot] = face
