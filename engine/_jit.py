"""The one way this package compiles per-element loops: numba, cached on disk, typed."""

from __future__ import annotations

import sys
from collections.abc import Callable
from inspect import getclosurevars
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
    nothing. Left out are kernels that only kernels call: they are compiled into those. Returns how
    many were loaded. (numba lists what it kept only through its own index.)
    """
    loaded = 0
    for kept in _called_from_python():
        index: Any = getattr(kept, "_cache")._cache_file  # noqa: B009
        for signature, *_ in index._load_index():
            kept.compile(signature)
            loaded += 1
    return loaded


def _called_from_python() -> list[Any]:
    """The kernels that no kernel calls, or that a module without kernels of its own imports."""
    known = _kernels_by_module()
    kernels = [kernel for name, some in known.items() for kernel in some if _home(kernel) == name]
    homes = {_home(kernel) for kernel in kernels}
    imported = {kernel for name, some in known.items() if name not in homes for kernel in some}
    called = {callee for kernel in kernels for callee in _callees(kernel)}
    return [kernel for kernel in kernels if kernel not in called or kernel in imported]


def _kernels_by_module() -> dict[str, list[Any]]:
    package = __name__.partition(".")[0]
    return {
        name: [value for value in vars(module).values() if isinstance(value, Dispatcher)]
        for name, module in tuple(sys.modules.items())
        if name.partition(".")[0] == package
    }


def _home(kernel: Any) -> str:
    return kernel.__module__


def _callees(kernel: Any) -> set[Any]:
    """The other kernels that it calls."""
    named = getclosurevars(kernel.py_func).globals.values()
    return {value for value in named if isinstance(value, Dispatcher)} - {kernel}
