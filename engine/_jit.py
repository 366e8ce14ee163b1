"""The one way this package compiles per-element loops: numba, cached on disk, typed."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba

Function = TypeVar("Function", bound=Callable[..., Any])


def kernel(function: Function) -> Function:
    """Compile ``function`` on first call and keep the machine code beside the source."""
    return cast(Function, numba.njit(cache=True, nogil=True)(function))
