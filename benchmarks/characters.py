"""Heads with pockets that nobody has seen: random MakeHuman characters in known and mixed units.

    python -m benchmarks.characters DATA OUT [--characters 6] [--seed 0]

``DATA`` is the data folder of MPFB (github.com/makehumancommunity/mpfb2, ``src/mpfb/data``; CC0).
A character is a sex, a race and an age with random weights, the positive parts of normally
distributed ones, on the sliders of head and face. Every one becomes a folder of ``OUT`` with a
``makehuman`` set in centimetres: neutral, nine expressions and four mixtures of expression units,
so that ``python -m benchmarks.correspondence OUT`` reads them all.
"""

from __future__ import annotations

import argparse
import gzip
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.correspondence import LARGE
from benchmarks.faces import rigidly_aligned
from engine.io import read_mesh
from engine.types import FloatArray, IntArray
from tests.acceptance.files import obj

CENTIMETRES = 10.0  # per unit of the model
NECK = 5.7  # height in the model above which faces are kept
BODY = 13_380  # vertices of skin, which come first
SEXES, RACES = ("female", "male"), ("african", "asian", "caucasian")
AGES = ("young", "young", "young", "old", "child")
REGIONS = ("cheek", "chin", "ears", "eyebrows", "eyes", "forehead", "head", "mouth", "neck", "nose")
SPREAD, MOST = 0.35, 1.0  # of the sliders' weights
# Weights of expression units; "*" stands for the left and the right one.
EXPRESSIONS: dict[str, dict[str, float]] = {
    "smile": {"mouth-corner-puller": 1, "eye-*-slit": 0.4},
    "mouth_open": {"mouth-open": 1},
    "surprise": {"mouth-open": 0.8, "eyebrows-*-up": 1, "eye-*-opened-up": 1},
    "anger": {"eyebrows-*-down": 1, "mouth-compression": 0.8, "nose-*-dilatation": 1},
    "sad": {"eyebrows-*-inner-up": 1, "mouth-depression": 1},
    "blink": {"eye-*-closure": 1},
    "pucker": {"mouth-protusion": 1, "mouth-pursing": 0.5},
    "disgust": {"nose-*-elevation": 1, "mouth-upward-retraction": 1, "eyebrows-*-down": 0.6},
    "wink": {"eye-left-closure": 1, "mouth-part-later": 0.6, "eyebrows-right-up": 1},
}
# What a mixture takes one of each from.
MOUTHS: tuple[dict[str, float], ...] = (
    {"mouth-open": 1, "mouth-corner-puller": 0.6},
    {"mouth-open": 0.7, "mouth-retraction": 0.8},
    {"mouth-open": 0.9, "mouth-protusion": 0.6},
    {"mouth-parling": 1, "mouth-depression-retraction": 0.6},
    {"mouth-open": 0.6, "mouth-upward-retraction": 0.8, "nose-*-elevation": 0.7},
    {"mouth-elevation": 0.8, "mouth-eversion": 0.6, "mouth-open": 0.5},
)
BROWS: tuple[dict[str, float], ...] = (
    {},
    {"eyebrows-*-up": 1},
    {"eyebrows-*-down": 1},
    {"eyebrows-left-extern-up": 1, "eyebrows-right-down": 0.8},
)
EYES: tuple[dict[str, float], ...] = (
    {},
    {"eye-*-opened-up": 1},
    {"eye-*-slit": 0.8},
    {"eye-right-closure": 1},
)
MIXTURES, LEAST = 4, 0.7


class Character:
    """Somebody's head without expression, (n, 3) in centimetres, and what units do to it."""

    def __init__(self, data: Path, random: np.random.Generator) -> None:
        self._targets = data / "targets"
        sex, age = random.choice(SEXES), random.choice(AGES)
        self._race = str(random.choice(RACES))
        self.name = f"{self._race} {sex} {age}"
        macro = (
            f"{self._race}-{sex}-{age}",
            f"universal-{sex}-{age}-averagemuscle-averageweight",
        )
        mesh = read_mesh(data / "3dobjs/base.obj").mesh
        faces = mesh.faces[(mesh.faces < BODY).all(axis=1)]
        faces = faces[(mesh.vertices[faces][:, :, 1] > NECK).all(axis=1)]
        self._kept, flat = np.unique(faces, return_inverse=True)
        self.faces: IntArray = flat.reshape(-1, 3)
        places = CENTIMETRES * mesh.vertices[self._kept]
        places = places + sum(self._target(f"macrodetails/{name}") for name in macro)
        self.neutral: FloatArray = places + self._sliders(random)

    def _sliders(self, random: np.random.Generator) -> FloatArray:
        """What random weights of all sliders of the head do, left and right alike."""
        total = np.zeros((len(self._kept), 3))
        files = [p for region in REGIONS for p in sorted((self._targets / region).glob("*.gz"))]
        names = [f"{path.parent.name}/{path.name.removesuffix('.target.gz')}" for path in files]
        for name in names:
            if name.split("/")[1].startswith("r-"):
                continue
            weight = float(np.clip(SPREAD * random.normal(), 0, MOST)) / 2
            both = {name, name.replace("/l-", "/r-")}
            total += sum(weight * self._target(each) for each in sorted(both))
        return total

    def expression(self, units: dict[str, float]) -> FloatArray:
        """How far (n, 3) weighted units take the head."""
        total = np.zeros_like(self.neutral)
        for name, weight in units.items():
            for side in ("left", "right") if "*" in name else ("",):
                unit = f"expression/units/{self._race}/{name.replace('*', side)}"
                total += weight * self._target(unit)
        return total

    def _target(self, name: str) -> FloatArray:
        return CENTIMETRES * _moved(self._targets / f"{name}.target.gz")[self._kept]


@cache
def _moved(path: Path) -> FloatArray:
    """How far a target moves each vertex of skin, in the model's unit."""
    lines = gzip.decompress(path.read_bytes()).decode().splitlines()
    rows = [line.split() for line in lines if line and not line.startswith("#")]
    moved = np.zeros((BODY, 3))
    for vertex, *move in rows:
        if int(vertex) < BODY:
            moved[int(vertex)] = [float(each) for each in move]
    return moved


def mixtures(character: Character, random: np.random.Generator) -> dict[str, FloatArray]:
    """``MIXTURES`` displacements, by name, that move a head enough to be judged by their share."""
    found: dict[str, FloatArray] = {}
    while len(found) < MIXTURES:
        chosen = [int(random.integers(len(each))) for each in (MOUTHS, BROWS, EYES)]
        units = MOUTHS[chosen[0]] | BROWS[chosen[1]] | EYES[chosen[2]]
        move = character.expression({u: w * random.uniform(LEAST, 1) for u, w in units.items()})
        moved = character.neutral + move
        still = np.linalg.norm(rigidly_aligned(character.neutral, moved) - moved, axis=1).mean()
        if still >= LARGE:
            found["mixed_" + "".join(map(str, chosen))] = move
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--characters", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    for who in range(arguments.characters):
        random = np.random.default_rng([arguments.seed, who])
        character = Character(arguments.data, random)
        folder = arguments.out / f"character_{who}" / "makehuman"
        folder.mkdir(parents=True, exist_ok=True)
        known = {name: character.expression(units) for name, units in EXPRESSIONS.items()}
        moves = {"neutral": np.zeros_like(character.neutral)} | known
        moves |= mixtures(character, random)
        for name, move in moves.items():
            file = folder / f"character_skin_{name}.obj"
            file.write_bytes(obj(character.neutral + move, character.faces.tolist()))
        print(f"{folder}: {character.name}; {', '.join(moves)}", flush=True)


if __name__ == "__main__":
    main()
