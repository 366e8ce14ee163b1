"""The one way this package compiles per-element loops: numba, cached on disk, typed."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from typing import Any, TypeVar, cast

import numba
from numba.core.dispatcher import Dispatcher

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile ``function`` on first call and keep the machine code beside the source."""
    return cast(Function, numba.njit(cache=True, nogil=True)(function))


def fast_kernel(function: Function) -> Function:
    """``kernel`` whose sums may be taken in any order and with fused multiplication."""
    fast = {"contract", "reassoc", "nsz"}
    compiled = numba.njit(cache=True, nogil=True, fastmath=fast, error_model="numpy")
    return cast(Function, compiled(function))


def load_kept_kernels() -> int:
    """Load the machine code that earlier processes kept for every kernel imported so far.

    For a process that forks others: a kernel that is loaded before the fork costs its children
    nothing. Returns how many were loaded. (numba lists what it kept only through its own index.)
    """
    loaded = 0
    for kept in _kernels():
        index: Any = getattr(kept, "_cache")._cache_file  # noqa: B009
        for signature, *_ in index._load_index():
            kept.compile(signature)
            loaded += 1
    return loaded


def _kernels() -> Iterator[Any]:
    package = __name__.partition(".")[0]
    for name, module in tuple(sys.modules.items()):
        if name.partition(".")[0] == package:
            for value in vars(module).values():
                if isinstance(value, Dispatcher) and value.__module__ == name:
                    yield value
