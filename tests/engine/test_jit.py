"""Which kernels a process loads before it forks others."""

from __future__ import annotations

from engine._jit import _called_from_python
from engine.cholesky import (
    _factor_kernels,
    _ordering_kernels,
    _separator_kernels,
    _solve_kernels,
    _tree_kernels,
)


def test_kernels_are_loaded_that_are_not_only_called_by_kernels() -> None:
    loaded = _called_from_python()
    for called_from_python in (
        _factor_kernels.factor_fronts,
        _ordering_kernels.nested_dissection,
        _solve_kernels.solve_fronts,
        _tree_kernels.postorder,  # by a kernel as well
    ):
        assert called_from_python in loaded
    for called_by_kernels in (_solve_kernels._forward, _separator_kernels.cut):
        assert called_by_kernels not in loaded
