"""Registration tasks with a known pose: expressions, halves, outliers, whole heads, scans.

The true pose is that of the part that did not move: the best rigid alignment of the half of the
common points that moves least. Targets are remeshed, shuffled, turned by anything up to 180° and
given in a unit between a thousandth and a thousand times that of their source.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from benchmarks.faces import SETS, expression_files, remeshed
from engine.io import read_mesh
from engine.types import BoolArray, FloatArray, IntArray, Mesh, Similarity

NOISE = 0.02  # of the targets called noisy, on a head of this height, cm
HEIGHT = 28.0
OUTLIERS = 0.05
FACE_KINDS = (
    "complete",
    "noise",
    "outliers",
    "half target",
    "half source",
    "extra parts",
    "free scale",
)
KINDS = (*FACE_KINDS, "whole head", "pairs", "scan")
HEADS = {
    "ict_full": ("ict_face/A_neutral.ply", "ict_full/neutral.obj", "ict_full/*.obj*"),
    "makehuman": (
        "makehuman/female_cauc_skin_neutral.obj",
        "makehuman/female_cauc_head_neutral.obj",
        "makehuman/*_head_*.obj",
    ),
    "cartoon_toon": (
        "cartoon_toon/toon_skin_neutral.obj",
        "cartoon_toon/toon_head_neutral.obj",
        "cartoon_toon/*_head_*.obj",
    ),
}
SCANS = ("scan_lee_perry_smith/lps_welded.ply", "scan_demosthenes/demosthenes.ply")


@dataclass(frozen=True)
class Case:
    """``truth`` carries the source onto the target; ``still`` (k, 3) source points to judge by.

    A result within ``degrees`` of the truth counts as right.
    """

    kind: str
    name: str
    source: Mesh
    target: Mesh
    truth: Similarity
    still: FloatArray
    degrees: float = 1.0
    free_scale: bool = False


def cases(data: Path, kinds: list[str], only: list[str] | None = None) -> Iterator[Case]:
    """The cases of ``kinds`` for every set that is in the folder ``data``."""
    for which in SETS:
        for number, (name, source, expression) in enumerate(_expressions(data, which)):
            if not only or name in only:
                yield from _face_cases(f"{which}/{name}", source, expression, number, kinds)
    for which in HEADS if "whole head" in kinds else ():
        yield from _heads(data, which, only)
    if "pairs" in kinds and (data / "pairs/pairs.json").exists():
        yield from _pairs(data / "pairs")
    for number, path in enumerate(SCANS if "scan" in kinds else ()):
        if (data / path).exists():
            mesh = read_mesh(data / path).mesh
            for case in _face_cases(Path(path).stem, mesh, mesh, number, list(FACE_KINDS)):
                yield replace(case, kind="scan", name=f"{case.name} {case.kind}")


def _expressions(data: Path, which: str) -> Iterator[tuple[str, Mesh, Mesh]]:
    neutral, files = expression_files(data, which)
    if neutral is None:
        return
    for name, path in files.items():
        yield name, read_mesh(neutral).mesh, read_mesh(path).mesh


def _face_cases(
    name: str, source: Mesh, expression: Mesh, number: int, kinds: list[str]
) -> Iterator[Case]:
    other = _remeshed(expression, number)
    for kind in FACE_KINDS:
        if kind not in kinds:
            continue
        random = np.random.default_rng([number, FACE_KINDS.index(kind)])
        near, target = source, other
        here = np.ones(len(source.vertices), dtype=np.bool_)
        half = kind.startswith("half") or (kind == "free scale" and number % 2 == 1)
        match kind:
            case "noise":
                size = NOISE * np.ptp(other.vertices, axis=0).max() / HEIGHT
                jitter = size * random.normal(size=other.vertices.shape)
                target = other.moved(other.vertices + jitter)
            case "outliers":
                target = _with_outliers(other, random)
            case "half target" | "free scale" if half:
                side, middle = _cut(expression.vertices, random)
                here = expression.vertices @ side < middle
                target = _part_of(other, other.vertices @ side < middle)
            case "half source":
                side, middle = _cut(source.vertices, random)
                here = source.vertices @ side < middle
                near = _part_of(source, here)
            case "extra parts":
                target = _with_parts(other, random)
            case _:
                pass
        scale = float(random.uniform(0.3, 3)) if kind == "free scale" else None
        pose = _any_pose(random, target, scale)
        still, rest = _still_part(source.vertices[here], expression.vertices[here])
        moved, free = target.moved(pose(target.vertices)), scale is not None
        degrees = 2.0 if half else 1.0
        yield Case(kind, name, near, moved, _after(pose, rest), still, degrees, free)


def _remeshed(mesh: Mesh, seed: int) -> Mesh:
    file, turn, shift = remeshed(mesh, seed, 0.0)
    return file.mesh.moved((file.mesh.vertices - shift) @ turn)


def _any_pose(random: np.random.Generator, mesh: Mesh, scale: float | None = None) -> Similarity:
    unit = scale or 10.0 ** random.integers(-3, 4)
    shift = random.normal(size=3) * np.ptp(mesh.vertices) * unit
    return Similarity(Rotation.random(random_state=random).as_matrix(), shift, unit)


def _cut(vertices: FloatArray, random: np.random.Generator) -> tuple[FloatArray, float]:
    """A plane, upright towards the face, with half of the vertices on either side."""
    angle = random.uniform(0, 2 * np.pi)
    side = np.array([np.cos(angle), np.sin(angle), 0.0])
    return side, float(np.median(vertices @ side))


def _part_of(mesh: Mesh, keep: BoolArray) -> Mesh:
    used, flat = np.unique(mesh.faces[keep[mesh.faces].all(axis=1)], return_inverse=True)
    return Mesh(mesh.vertices[used], flat.reshape(-1, 3))


def _joined(first: Mesh, second: Mesh) -> Mesh:
    return Mesh(
        np.concatenate([first.vertices, second.vertices]),
        np.concatenate([first.faces, second.faces + len(first.vertices)]),
    )


def _with_outliers(mesh: Mesh, random: np.random.Generator) -> Mesh:
    """Spikes at one vertex in twenty and as many loose triangles all around."""
    size = np.ptp(mesh.vertices, axis=0)
    vertices = mesh.vertices.copy()
    count = int(OUTLIERS * len(vertices))
    spikes = random.choice(len(vertices), count, replace=False)
    vertices[spikes] += 0.1 * size.max() * random.normal(size=(count, 3))
    middle = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    centres = middle + 1.5 * size * random.uniform(-0.5, 0.5, size=(count, 3))
    corners = centres[:, None] + 0.01 * size.max() * random.normal(size=(count, 3, 3))
    loose = Mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))
    return _joined(mesh.moved(vertices), loose)


def _with_parts(mesh: Mesh, random: np.random.Generator) -> Mesh:
    """A turned copy of a third of the surface beside it, and shoulders below."""
    centre = mesh.vertices[random.integers(len(mesh.vertices))]
    distance = np.linalg.norm(mesh.vertices - centre, axis=1)
    copy = _part_of(mesh, distance < np.quantile(distance, 1 / 3))
    size = np.ptp(mesh.vertices, axis=0)
    turn = Rotation.random(random_state=random).as_matrix()
    beside = (copy.vertices - centre) @ turn.T + centre + [1.2 * size[0], 0, 0]
    u, v = np.meshgrid(np.linspace(-1, 1, 60), np.linspace(0, np.pi, 40), indexing="ij")
    arch = np.stack([1.2 * u, 0.25 * np.sin(v) - 0.3 * u**2, 0.4 * np.cos(v)], axis=-1)
    below = [0, mesh.vertices[:, 1].min() - 0.1 * size[1], 0]
    a = (np.arange(59)[:, None] * 40 + np.arange(39)).ravel()
    sheet = np.concatenate([np.stack([a, a + 40, a + 1], 1), np.stack([a + 1, a + 40, a + 41], 1)])
    shoulders = Mesh(size[1] * arch.reshape(-1, 3) + below, sheet)
    return _joined(_joined(mesh, copy.moved(beside)), shoulders)


def _still_part(source: FloatArray, moved: FloatArray) -> tuple[FloatArray, Similarity]:
    """The half of the points that moves least, and the rigid motion of that half."""
    rest = Similarity(np.eye(3), np.zeros(3))
    still = np.ones(len(source), dtype=np.bool_)
    for _ in range(50):
        distance = np.linalg.norm(rest(source) - moved, axis=1)
        still = distance <= np.median(distance)
        here, there = source[still].mean(axis=0), moved[still].mean(axis=0)
        turn = Rotation.align_vectors(moved[still] - there, source[still] - here)[0].as_matrix()
        rest = Similarity(turn, there - turn @ here)
    return source[still], rest


def _after(second: Similarity, first: Similarity) -> Similarity:
    return Similarity(
        second.rotation @ first.rotation, second(first.translation), second.scale * first.scale
    )


def _heads(data: Path, which: str, only: list[str] | None) -> Iterator[Case]:
    face, whole, pattern = HEADS[which]
    if not (data / whole).exists():
        return
    source, neutral = read_mesh(data / face).mesh, read_mesh(data / whole).mesh
    same: IntArray = KDTree(neutral.vertices).query(source.vertices)[1]
    for number, path in enumerate(sorted(data.glob(pattern))):
        name = path.name.split(".")[0]
        if only and name not in only:
            continue
        packed = path.read_bytes()
        head = read_mesh(gzip.decompress(packed) if path.suffix == ".gz" else packed).mesh
        pose = _any_pose(np.random.default_rng([number, 99]), head)
        still, rest = _still_part(source.vertices, head.vertices[same])
        moved = head.moved(pose(head.vertices))
        yield Case("whole head", f"{which}/{name}", source, moved, _after(pose, rest), still)


def _pairs(folder: Path) -> Iterator[Case]:
    for number, name in enumerate(json.loads((folder / "pairs.json").read_text())):
        truth = np.load(folder / f"{name}_gt.npz")
        source = read_mesh(folder / f"{name}_source.ply").mesh
        target = read_mesh(folder / f"{name}_target.ply").mesh
        valid = truth["valid"].astype(np.bool_)
        still, rest = _still_part(source.vertices[valid], truth["expr_pos"][valid])
        given = Similarity(truth["R"], truth["t"], float(truth["scale"]))
        turned = _any_pose(np.random.default_rng([number, 98]), target)
        for words, pose in (("as given", Similarity(np.eye(3), np.zeros(3))), ("turned", turned)):
            whole = _after(pose, _after(given, rest))
            moved = target.moved(pose(target.vertices))
            yield Case("pairs", f"{name} {words}", source, moved, whole, still, 2.0)
