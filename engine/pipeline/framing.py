"""Which frames an edit has: times and weights along the way."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from engine.pipeline.values import EditPlan


@dataclass(frozen=True, slots=True)
class Moment:
    """One frame to make: ``share`` scales the final weights and moves, or keyframes say all."""

    time: float
    share: float
    weights: Mapping[str, float]


def general_weights(plan: EditPlan, targets: Sequence[str]) -> dict[str, float]:
    """One weight per target: as given (left out: 0), else 1 each."""
    if plan.weights is None and not plan.distances:
        return dict.fromkeys(targets, 1.0)
    return {name: (plan.weights or {}).get(name, 0.0) for name in targets}


def moments(plan: EditPlan, targets: Sequence[str]) -> list[Moment]:
    """The frames in order: time 0 is the source unless keyframes say otherwise."""
    if plan.keyframes:
        return _along_keyframes(plan, targets)
    weights = general_weights(plan, targets)
    if plan.frames is None:
        return [Moment(1.0, 1.0, weights)]
    times = np.linspace(0.0, 1.0, plan.frames) if plan.frames > 1 else np.ones(1)
    return [
        Moment(float(time), float(time), {name: w * float(time) for name, w in weights.items()})
        for time in times
    ]


def _along_keyframes(plan: EditPlan, targets: Sequence[str]) -> list[Moment]:
    keys = sorted(plan.keyframes, key=lambda key: key.time)
    at = np.array([key.time for key in keys])
    times = at if plan.frames is None else np.linspace(at[0], at[-1], plan.frames)
    span = at[-1] - at[0]
    shares = (times - at[0]) / span if span > 0 else np.ones(len(times))
    paths = {
        name: np.interp(times, at, [key.weights.get(name, 0.0) for key in keys]) for name in targets
    }
    return [
        Moment(float(time), float(share), {name: float(p[i]) for name, p in paths.items()})
        for i, (time, share) in enumerate(zip(times, shares, strict=True))
    ]
