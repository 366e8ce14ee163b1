"""The steps of a fit: how smooth each is, how far it reaches, and where it begins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from engine.correspondence._fitting import Step

_LEADING = 15  # coarse steps
# skin follows a wide mouth but slowly: the second coarse step and those after it begin beyond
_AHEAD, _HURRIED = 0.2, 5  # by that share, and how many do
# smoothness keeps a fifth of the displacement back: fine steps start beyond it, the last ones twice
_BEYOND, _TWICE = 0.2, 3


def geometric_steps(
    count: int,
    smooth: tuple[float, float],
    reach: tuple[float, float],
    normal_weight: tuple[float, float],
) -> tuple[Step, ...]:
    """``count`` steps whose lengths go from the first to the second value of each pair."""
    lengths = [np.geomspace(a, b, count) for a, b in (smooth, reach, normal_weight)]
    return tuple(Step(*map(float, values)) for values in zip(*lengths, strict=True))


def leading_steps(smooth: tuple[float, float], reach: tuple[float, float]) -> tuple[Step, ...]:
    """Coarse steps; those after the first begin beyond where the last one ended."""
    return tuple(
        replace(step, beyond=_AHEAD if 0 < turn <= _HURRIED else 0.0)
        for turn, step in enumerate(geometric_steps(_LEADING, smooth, reach, (0.2, 0.1)))
    )


def fetching_steps(steps: tuple[Step, ...], fetched: float) -> tuple[Step, ...]:
    """``steps``, the last ones twice, begun beyond either time: by the share to be ``fetched``."""
    if fetched == 0:
        return steps
    share = _BEYOND * fetched
    first, last = steps, steps[-_TWICE:]
    return tuple(
        replace(step, beyond=share if turn == 0 else 0.0)
        for part in (first, last)
        for turn, step in enumerate(part)
    )
