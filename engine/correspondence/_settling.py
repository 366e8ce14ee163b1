"""Rims without a counterpart find their own places once the surfaces nearly coincide."""

from __future__ import annotations

import numpy as np

from engine.correspondence._fitting import Displacement, Fitting, Source, Target
from engine.correspondence._levels import build_level
from engine.correspondence._marks import Marks
from engine.correspondence._plan import Plan, geometric_steps
from engine.types import FloatArray, IntArray, Mesh

_VERTICES, _COMPARED = 2300, 5000
_STEPS = geometric_steps(6, (0.03, 0.015), (0.04, 0.02), (0.1, 0.1))


def settle(
    rest: Mesh,
    loops: tuple[IntArray, ...],
    positions: FloatArray,
    goal: Target,
    plan: Plan,
    marks: Marks,
) -> FloatArray:
    """``positions`` (n, 3) of ``rest``, fitted on to the whole of ``goal`` without loops.

    A hole of the source ends somewhere inside the target's cavity, not at that cavity's rim.
    """
    fitting = Fitting(
        Source(rest, np.zeros((len(positions), 3, 0))),
        build_level(rest, loops, _VERTICES),
        goal,
        (),
        marks,
        plan.weights,
        plan.static,
        np.zeros_like(positions),
        _COMPARED,
    )
    start = Displacement(positions - rest.vertices, np.zeros(0))
    return rest.vertices + fitting.run(start, _STEPS).free
