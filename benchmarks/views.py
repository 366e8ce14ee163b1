"""How near the correspondence comes to the truth on what one depth camera saw of a whole head.

    python -m benchmarks.views FaceXModel [--identities 6] [--seed 0] [--noise 0.03]

Random identities of the model of ``benchmarks.identities`` in four expressions each, seen from
afar, 0 to 35° from the side: eyeballs, teeth and lashes in view, cells of 1 mm, noise along the
line of sight, grazing skin and small patches missing, turned by 40°, in metres. Where the jaw hides
what is behind it the view is torn: errors are those of vertices on the piece that is used.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from benchmarks.correspondence import judged, summarise
from benchmarks.correspondence_tasks import Task
from benchmarks.faces import as_file
from benchmarks.identities import (
    BROWS,
    EXPRESSIONS,
    FACE_TRIANGLES,
    FACE_VERTICES,
    MOUTHS,
    FaceModel,
    both_sides,
)
from engine.pipeline.preparation import find_surface
from engine.types import BoolArray, FloatArray, IntArray, Mesh

CELL, HALF = 0.1, 180  # of the depth image: side, cm, and half its width in cells
GRAZING, STEP = 0.2, 0.5  # least cosine to the line of sight; deepest step within a face, cm
PATCHES = 25  # that are missing
UNIT = 0.01  # of the source's
CASES = (
    ("surprise", 20, EXPRESSIONS["surprise"]),
    ("smile", -20, EXPRESSIONS["smile"]),
    ("laugh", 30, EXPRESSIONS["laugh"]),
    ("kiss", -25, MOUTHS["kiss"]),
    ("shout", 10, MOUTHS["shout"]),
    ("grin", -35, MOUTHS["grin"] | {"eyeSquint_": 0.7}),
    ("aside", 20, MOUTHS["aside"] | {"browDown_R": 0.8}),
    ("grimace", -15, MOUTHS["grimace"] | BROWS["lowered"]),
    ("jaw_open", 0, EXPRESSIONS["jaw_open"]),
    ("sneer", 25, EXPRESSIONS["sneer"]),
    ("asymmetric", -20, EXPRESSIONS["asymmetric"]),
    ("cheek_puff", 15, EXPRESSIONS["cheek_puff"]),
)
EACH = 4
PITCHES = (-10, 0, 8)


def twice_area(a: FloatArray, b: FloatArray) -> FloatArray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def depth_image(points: FloatArray, faces: IntArray) -> FloatArray:
    """The greatest z at the centre of every cell, nan where there is none; ``points`` (n, 3)."""
    image = np.full((2 * HALF, 2 * HALF), -np.inf)
    corners = points[faces] / [CELL, CELL, 1.0]
    low = np.ceil(corners[:, :, :2].min(axis=1)).astype(np.int64)
    size = np.floor(corners[:, :, :2].max(axis=1)).astype(np.int64) - low + 1
    a, b, c = np.moveaxis(corners, 1, 0)
    twice = twice_area(b - a, c - a)
    for i in range(size[:, 0].max()):
        for j in range(size[:, 1].max()):
            here = np.flatnonzero((size[:, 0] > i) & (size[:, 1] > j) & (twice > 1e-12))
            at = low[here] + [i, j]
            u = twice_area((c - b)[here], at - b[here, :2]) / twice[here]
            v = twice_area((a - c)[here], at - c[here, :2]) / twice[here]
            z = u * a[here, 2] + v * b[here, 2] + (1 - u - v) * c[here, 2]
            inside = (u >= 0) & (v >= 0) & (u + v <= 1) & (np.abs(at + 0.5) < HALF).all(axis=1)
            x, y = (at[inside] + HALF).T
            np.maximum.at(image, (x, y), z[inside])
    return np.where(np.isfinite(image), image, np.nan)


def seen(depth: FloatArray, random: np.random.Generator, noise: float) -> Mesh:
    """The mesh of a depth image without what grazes, with patches missing and with noise."""
    slope = np.hypot(*np.gradient(depth, CELL))
    depth = np.where(slope < np.sqrt(1 / GRAZING**2 - 1), depth, np.nan)
    x, y = np.meshgrid(*[np.arange(-HALF, HALF)] * 2, indexing="ij")
    for _ in range(PATCHES):
        at, radius = random.integers(-HALF, HALF, 2), random.uniform(1, 3.5)
        depth[(x - at[0]) ** 2 + (y - at[1]) ** 2 < radius**2] = np.nan
    depth = depth + noise * random.normal(size=depth.shape)
    number = np.arange(depth.size).reshape(depth.shape)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[:-1, 1:], number[1:, 1:]
    faces = np.concatenate([np.stack(k, axis=2).reshape(-1, 3) for k in ((a, b, d), (a, d, c))])
    deep = depth.ravel()[faces]
    faces = faces[np.isfinite(deep).all(axis=1) & (np.ptp(deep, axis=1) < STEP)]
    used, flat = np.unique(faces, return_inverse=True)
    order = random.permutation(len(used))
    place = np.argsort(order)
    points = np.stack([CELL * x.ravel(), CELL * y.ravel(), depth.ravel()], axis=1)[used[order]]
    return Mesh(points, place[flat.reshape(-1, 3)])


def visible(points: FloatArray, depth: FloatArray) -> BoolArray:
    """Which of ``points`` (n, 3) nothing hides."""
    x, y = np.clip(np.rint(points[:, :2] / CELL).astype(np.int64) + HALF, 0, 2 * HALF - 1).T
    return ~(depth[x, y] > points[:, 2] + STEP)


def views(model: FaceModel, identities: int, seed: int, noise: float) -> Iterator[Task]:
    for who in range(identities):
        neutral = model.identity(np.random.default_rng([seed, who]))
        source = as_file(Mesh(neutral[:FACE_VERTICES], model.faces[:FACE_TRIANGLES]))
        for k in range(EACH):
            name, yaw, weights = CASES[(EACH * who + k) % len(CASES)]
            random = np.random.default_rng([seed, who, k])
            head = neutral + model.combined(both_sides(weights))
            turn = Rotation.from_euler("yx", [-yaw, PITCHES[(who + k) % 3]], degrees=True)
            places = turn.apply(head - head[:FACE_VERTICES].mean(axis=0))
            depth = depth_image(places, model.faces)
            target = seen(depth, random, noise)
            axis = random.normal(size=3)
            turned = Rotation.from_rotvec(np.deg2rad(40) * axis / np.linalg.norm(axis))
            pose = UNIT * turned.as_matrix().T
            file = as_file(Mesh(target.vertices @ pose, target.faces))
            used = find_surface(file, ())[0].vertex_of >= 0
            face = places[:FACE_VERTICES]
            gap, nearest = KDTree(target.vertices).query(face)
            valid = visible(face, depth) & (gap < 2 * CELL) & used[nearest]
            marks = np.zeros(0, dtype=np.int64)
            yield Task(
                "views", f"{who} {name} {yaw}°", source, file, face @ pose, UNIT, valid, marks
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model", type=Path, metavar="FaceXModel")
    parser.add_argument("--identities", type=int, default=6)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--noise", type=float, default=0.03, help="cm")
    arguments = parser.parse_args()
    model = FaceModel(arguments.model, whole=True)
    rows = []
    for task in views(model, arguments.identities, arguments.seed, arguments.noise):
        rows.append(judged(task, "automatic"))
        print(rows[-1], flush=True)
    summarise(rows)


if __name__ == "__main__":
    main()
