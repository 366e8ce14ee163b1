"""BLAS on one thread while sparse factors are made and used."""

from __future__ import annotations

from threading import Lock
from types import TracebackType
from typing import Any

from threadpoolctl import ThreadpoolController


class OneThread:
    """A context in which BLAS works on one thread, as long as anyone is inside.

    Fronts are small: threads that share one wait for each other, busily, for longer than the work
    takes, several times longer where the cores have other things to do. And sums are the same on
    every machine.
    """

    def __init__(self) -> None:
        self._lock = Lock()
        self._inside = 0
        self._pools: Any = None
        self._limits: Any = None

    def __enter__(self) -> None:
        with self._lock:
            if self._pools is None:
                self._pools = ThreadpoolController()
            if self._inside == 0:
                self._limits = self._pools.limit(limits=1, user_api="blas")
            self._inside += 1

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._lock:
            self._inside -= 1
            if self._inside == 0:
                self._limits.restore_original_limits()


one_thread = OneThread()
