"""Faces that nobody has seen: random identities of ICT FaceKit in known and in mixed expressions.

    python -m benchmarks.identities FaceXModel OUT [--identities 6] [--seed 0]

``FaceXModel`` is the folder of the published model (github.com/ICT-VGL/ICT-FaceKit, MIT): meshes
over the same vertices, in centimetres. An identity is its generic face with normally distributed
weights on all 100 modes. Every one becomes a folder of ``OUT`` with an ``ict_face`` set of the
bundled identity's patch: neutral, its ten expressions and four mixtures of blendshapes, so that
``python -m benchmarks.correspondence OUT`` reads them all.
"""

from __future__ import annotations

import argparse
import shutil
from functools import cache
from pathlib import Path

import numpy as np

from benchmarks.correspondence import LARGE
from benchmarks.correspondence_tasks import BUNDLED
from benchmarks.faces import rigidly_aligned
from engine.io import read_mesh
from engine.types import FloatArray, IntArray
from tests.acceptance.files import ply

FACE_VERTICES, FACE_TRIANGLES = 9409, 18_460  # those of the face come first in the model
MODES = 100
MIXTURES = 4
# Weights of blendshapes; a name that ends in an underscore stands for the left and the right one.
EXPRESSIONS: dict[str, dict[str, float]] = {
    "smile": {"mouthSmile_": 1, "cheekSquint_": 0.6},
    "jaw_open": {"jawOpen": 1},
    "surprise": {"jawOpen": 0.7, "browInnerUp_": 1, "browOuterUp_": 1, "eyeWide_": 1},
    "frown": {"mouthFrown_": 1, "browDown_": 1, "mouthShrugLower": 0.5},
    "blink": {"eyeBlink_": 1},
    "pucker": {"mouthPucker": 1},
    "cheek_puff": {"cheekPuff_": 1},
    "sneer": {"noseSneer_": 1, "mouthUpperUp_": 0.8, "browDown_": 0.6},
    "laugh": {
        "jawOpen": 0.5,
        "mouthSmile_": 1,
        "cheekSquint_": 1,
        "eyeSquint_": 1,
        "mouthUpperUp_": 0.3,
    },
    "asymmetric": {"mouthLeft": 0.8, "mouthSmile_L": 0.7, "browOuterUp_L": 1, "eyeBlink_R": 1},
}
# What a mixture takes one of each from, with the most that each blendshape weighs.
MOUTHS: dict[str, dict[str, float]] = {
    "grin": {"mouthSmile_": 1, "cheekSquint_": 0.8, "mouthDimple_": 0.4},
    "smirk": {"mouthSmile_L": 1, "cheekSquint_L": 0.7, "mouthLeft": 0.5},
    "open": {"jawOpen": 0.9, "jawRight": 0.3},
    "shout": {"jawOpen": 1, "mouthLowerDown_": 0.7, "mouthUpperUp_": 0.5, "mouthStretch_": 0.5},
    "kiss": {"mouthPucker": 1, "jawOpen": 0.1},
    "funnel": {"mouthFunnel": 1, "jawOpen": 0.4},
    "snarl": {"mouthUpperUp_": 1, "noseSneer_": 1, "jawOpen": 0.3, "mouthLowerDown_": 0.4},
    "stretch": {"mouthStretch_": 1, "mouthLowerDown_": 0.8, "jawOpen": 0.2},
    "aside": {"mouthRight": 1, "jawRight": 0.4, "cheekPuff_L": 0.4},
    "grimace": {"mouthFrown_": 0.8, "mouthStretch_": 0.9, "mouthUpperUp_": 0.5, "jawOpen": 0.3},
}
BROWS: dict[str, dict[str, float]] = {
    "": {},
    "raised": {"browInnerUp_": 1, "browOuterUp_": 1},
    "lowered": {"browDown_": 1, "noseSneer_": 0.3},
    "worried": {"browInnerUp_": 1, "browDown_": 0.3},
    "skew": {"browOuterUp_L": 1, "browDown_R": 0.8},
}
EYES: dict[str, dict[str, float]] = {
    "": {},
    "wide": {"eyeWide_": 1},
    "squint": {"eyeSquint_": 1, "cheekSquint_": 0.7},
    "wink": {"eyeBlink_R": 1, "cheekSquint_R": 0.9},
}
LEAST, UNLIKE = 0.7, 0.2  # of the most: the least weight; by how much either side may have less


class FaceModel:
    """The published meshes of a ``folder``, restricted to the face patch unless ``whole``."""

    def __init__(self, folder: Path, *, whole: bool = False) -> None:
        self._folder = folder
        mesh = read_mesh(folder / "generic_neutral_mesh.obj").mesh
        self.faces: IntArray = mesh.faces if whole else mesh.faces[:FACE_TRIANGLES]
        self.generic: FloatArray = mesh.vertices if whole else mesh.vertices[:FACE_VERTICES]

    def combined(self, weights: dict[str, float]) -> FloatArray:
        """How far (n, 3) weighted meshes take the face from the generic one."""
        total = np.zeros_like(self.generic)
        for name, weight in weights.items():
            there = _vertices(self._folder / f"{name}.obj")[: len(self.generic)]
            total += weight * (there - self.generic)
        return total

    def identity(self, random: np.random.Generator) -> FloatArray:
        """The neutral face of somebody, by normally distributed weights on all modes."""
        modes = {f"identity{k:03d}": random.normal() for k in range(MODES)}
        return self.generic + self.combined(modes)


@cache
def _vertices(path: Path) -> FloatArray:
    return read_mesh(path).mesh.vertices


def both_sides(weights: dict[str, float]) -> dict[str, float]:
    sides = {name: (f"{name}L", f"{name}R") if name[-1] == "_" else (name,) for name in weights}
    return {side: weights[name] for name, names in sides.items() for side in names}


def mixture(random: np.random.Generator) -> tuple[str, dict[str, float]]:
    """The name and weights of a mouth, brows and eyes, each about as strong as it may be."""
    names, weights = [], dict[str, float]()
    for choice in (MOUTHS, BROWS, EYES):
        name = str(random.choice(list(choice)))
        strength = random.uniform(LEAST, 1)
        for shape, most in both_sides(choice[name]).items():
            weight = most * strength * random.uniform(1 - UNLIKE, 1)
            weights[shape] = max(weights.get(shape, 0.0), weight)
        names += [name] if name else []
    return "_".join(names), weights


def mixtures(
    model: FaceModel, neutral: FloatArray, random: np.random.Generator
) -> dict[str, FloatArray]:
    """``MIXTURES`` displacements, by name, that move a face enough to be judged by their share."""
    found: dict[str, FloatArray] = {}
    while len(found) < MIXTURES:
        name, weights = mixture(random)
        move = model.combined(weights)
        moved = neutral + move
        still = np.linalg.norm(rigidly_aligned(neutral, moved) - moved, axis=1).mean()
        if still >= LARGE:
            found[f"mixed_{name}"] = move
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model", type=Path, metavar="FaceXModel")
    parser.add_argument("out", type=Path)
    parser.add_argument("--identities", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    model = FaceModel(arguments.model)
    known = {name: model.combined(both_sides(w)) for name, w in EXPRESSIONS.items()}
    for who in range(arguments.identities):
        random = np.random.default_rng([arguments.seed, who])
        folder = arguments.out / f"identity_{who}" / "ict_face"
        folder.mkdir(parents=True, exist_ok=True)
        neutral = model.identity(random)
        moves = {"neutral": np.zeros_like(neutral)} | known | mixtures(model, neutral, random)
        for name, move in moves.items():
            (folder / f"A_{name}.ply").write_bytes(ply(neutral + move, model.faces))
        shutil.copy(BUNDLED / "ict_face/landmarks.json", folder)
        print(f"{folder}: {', '.join(moves)}", flush=True)


if __name__ == "__main__":
    main()
