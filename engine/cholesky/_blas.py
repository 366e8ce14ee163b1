"""The BLAS and LAPACK that scipy carries, callable from compiled kernels.

Arguments are addresses, as in Fortran. The symbols are registered under names, so that kernels
that call them can be kept on disk. An array must outlive the call that is given its address: the
constants live here, scratch belongs to the caller's caller.
"""

from __future__ import annotations

from typing import Any, cast

import numpy as np
from llvmlite import binding
from numba import types
from numba.extending import get_cython_function_address

LETTERS = np.frombuffer(b"LRNT", np.uint8)
L, R, N, T = 0, 1, 2, 3
REALS = np.array([1.0, 0.0, -1.0])
ONE, ZERO, MINUS = 0, 8, 16


def _external(module: str, name: str, arguments: int) -> Any:
    symbol = f"quasiface_{name}"
    binding.add_symbol(symbol, get_cython_function_address(module, name))
    signature = types.void(*[types.intp] * arguments)
    return cast(Any, types).ExternalFunction(symbol, signature)


potrf: Any = _external("scipy.linalg.cython_lapack", "dpotrf", 5)
trsm: Any = _external("scipy.linalg.cython_blas", "dtrsm", 11)
syrk: Any = _external("scipy.linalg.cython_blas", "dsyrk", 10)
gemm: Any = _external("scipy.linalg.cython_blas", "dgemm", 13)
