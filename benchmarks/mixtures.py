"""Several expressions at once, with weights below 0 and above 1: the plain blend, and the edit.

Four expressions of a face, each with a random weight from -0.5 to 1.5, again and again. Faces
turned over that the same mixture with its weights cut to 0 … 1 has open, and faces that pass
through others more than they do there: the mean of all mixtures, and the most; the greatest depth
of skin in the skin that faces it, as a share of the diagonal; the median share of the way beyond
that is given up; the largest vertex step over its mean on 40 even steps from one random mixture
to another, the least and the greatest of several such ways.

    python -m benchmarks.mixtures DATA [--sets ict_face …] [--mixtures 40] [--ways 8]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from benchmarks.beyond import Judge, given_up
from benchmarks.faces import SETS, expressions
from benchmarks.transitions import largest_step
from engine.restoration import Blender, Extrapolator
from engine.types import FloatArray

FOURS = ((0, 1, 2, 3), (1, 2, 4, 5), (3, 4, 5, 6))  # of a face's expressions in alphabetical order
WEIGHTS = (-0.5, 1.5)
STEPS = 40


def report(name: str, plain: Blender, seed: int, mixtures: int, ways: int) -> None:
    random = np.random.default_rng(seed)
    sane, judge = Extrapolator(plain), Judge(plain)
    found: list[FloatArray] = []
    lost: list[float] = []
    for weights in random.uniform(*WEIGHTS, size=(mixtures, len(plain.shapes))):
        within = plain.at(np.clip(weights, 0.0, 1.0))
        surfaces = [way.at(weights) for way in (plain, sane)]
        found.append(judge.found(surfaces, within))
        if ((weights < 0.0) | (weights > 1.0)).any():
            lost.append(given_up(*surfaces, within))
    steps = [largest_step(path(sane, *ends)) for ends in between(random, ways, len(plain.shapes))]
    mean, most = np.mean(found, axis=0), np.max(found, axis=0)
    print(
        f"{name}: turned over {mean[0, 0]:.1f} > {mean[1, 0]:.1f} (at most {most[0, 0]:.0f} > "
        f"{most[1, 0]:.0f}), passing {mean[0, 1]:.0f} > {mean[1, 1]:.0f} (at most "
        f"{most[0, 1]:.0f} > {most[1, 1]:.0f}), depth {most[0, 2]:.2%} > {most[1, 2]:.2%}; given "
        f"up {np.median(lost):.0%}; largest step {min(steps):.1f} to {max(steps):.1f} x mean",
        flush=True,
    )


def between(random: np.random.Generator, ways: int, shapes: int) -> FloatArray:
    """Pairs of mixtures (ways, 2, shapes)."""
    return random.uniform(*WEIGHTS, size=(ways, 2, shapes))


def path(sane: Extrapolator, first: FloatArray, last: FloatArray) -> FloatArray:
    """Positions (steps + 1, n, 3) on the straight way from one mixture to another."""
    times = np.linspace(0.0, 1.0, STEPS + 1)
    return np.stack([sane.at(first + time * (last - first)) for time in times])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--sets", nargs="+", default=list(SETS))
    parser.add_argument("--mixtures", type=int, default=40)
    parser.add_argument("--ways", type=int, default=8)
    arguments = parser.parse_args()
    for which in arguments.sets:
        mesh, shapes = expressions(arguments.data, which)
        for seed, four in enumerate(FOURS):
            names = [sorted(shapes)[index] for index in four]
            plain = Blender(mesh, [shapes[name] for name in names])
            report(f"{which} {', '.join(names)}", plain, seed, arguments.mixtures, arguments.ways)


if __name__ == "__main__":
    main()
