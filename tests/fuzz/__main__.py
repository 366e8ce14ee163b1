"""Coverage-guided fuzzing of the readers and writers, by Atheris (libFuzzer).

``python -m tests.fuzz FOUND tests/fuzz/corpus -max_total_time=1800``: new inputs go to the folder
FOUND, what breaks the contract to ``crash-…``. Compiled kernels run as Python, so that their
branches guide the search and a place outside an array is an error.
"""

from __future__ import annotations

import os
import sys

os.environ["NUMBA_DISABLE_JIT"] = "1"

import atheris
import numpy as np

with atheris.instrument_imports(include=["engine.io"]):
    from engine.io import _obj_patch, _obj_reader, _ply_body, _ply_patch, _text_numbers
    from tests.engine.io.contract import check


class Bytes(np.ndarray):
    """Bytes whose elements are Python's integers, as they are the widest ones when compiled."""

    def __getitem__(self, key: object) -> object:
        found = super().__getitem__(key)
        return int(found) if isinstance(found, np.uint8) else found


def widened(data: bytes) -> np.ndarray:
    return np.frombuffer(data, np.uint8).view(Bytes)


def main() -> None:
    for module in (_obj_patch, _obj_reader, _ply_body, _ply_patch, _text_numbers):
        module.as_bytes = widened
    np.seterr(all="ignore")
    atheris.Setup(sys.argv, check_and_forget)
    atheris.Fuzz()


def check_and_forget(data: bytes) -> None:
    check(data)


main()
