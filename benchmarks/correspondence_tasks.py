"""What the correspondence is judged on: pairs of files and where each source vertex truly is."""

from __future__ import annotations

import gzip
import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import KDTree

from benchmarks.faces import HEADS, SETS, as_file, expression_files, pairs, remeshed
from engine.correspondence._cavities import find_cavities
from engine.io import MeshFile, read_mesh
from engine.pipeline.preparation import find_surface
from engine.types import BoolArray, FloatArray, IntArray, Mesh
from engine.visibility import ambient_visibility

ALL_SETS = (*SETS, *HEADS, "pairs", "whole head", "half missing", "coarse", "half head")
BUNDLED = Path(__file__).parent.parent / "examples"
SEVERAL = ("ict_face/A_smile", "ict_face/A_jaw_open", "ict_face/A_surprise", "ict_face/A_pucker")


@dataclass(frozen=True)
class Task:
    """``truth`` (n, 3): the source's vertices on the target, in the target's frame and unit.

    ``scale``: the target's lengths per length of the source. Only ``valid`` vertices are on the
    target. ``landmarks``: vertices whose places may be given.
    """

    group: str
    name: str
    source: MeshFile
    target: MeshFile
    truth: FloatArray
    scale: float
    valid: BoolArray
    landmarks: IntArray


def tasks(data: Path, group: str, noise: float, only: list[str] | None = None) -> Iterator[Task]:
    """The tasks of one of ``ALL_SETS``; none where the folder lacks its files.

    A folder of ``identities`` has those of each. ``only``: words of which a name must have one.
    """
    sets = (path for which in SETS for path in data.glob(f"*/{which}"))
    people = sorted({path.parent for path in sets})
    for person in people or [data]:
        for task in _tasks(person, group, noise, only):
            if not only or any(word in task.name for word in only):
                named = f"{person.name} {task.name}" if people else task.name
                yield replace(task, name=named)


def _tasks(data: Path, group: str, noise: float, only: list[str] | None) -> Iterator[Task]:
    match group:
        case "pairs":
            yield from _listed_pairs(data)
        case "whole head":
            yield from _whole_heads(data)
        case "half missing" | "coarse":
            yield from _reduced(data, group, noise, only)
        case "half head":
            yield from _half_heads(data, noise, only)
        case _:
            for pair in pairs(data, group, noise=noise, only=only):
                every = np.ones(len(pair.truth), dtype=np.bool_)
                yield Task(
                    group,
                    pair.name,
                    pair.source,
                    pair.target,
                    pair.truth,
                    1.0,
                    every,
                    pair.landmarks,
                )


def _multi_pie(data: Path) -> IntArray:
    listed = data / "ict_face/landmarks.json"
    if not listed.exists():
        return np.zeros(0, dtype=np.int64)
    return np.asarray(json.loads(listed.read_text())["multi_pie_68"][17:], dtype=np.int64)


def _listed_pairs(data: Path) -> Iterator[Task]:
    folder = data / "pairs"
    if not (folder / "pairs.json").exists():
        return
    for name in json.loads((folder / "pairs.json").read_text()):
        known = np.load(folder / f"{name}_gt.npz")
        valid = known["valid"].astype(np.bool_)
        marks = _multi_pie(data)
        yield Task(
            "pairs",
            name,
            read_mesh(folder / f"{name}_source.ply"),
            read_mesh(folder / f"{name}_target.ply"),
            known["target_pos"],
            float(known["scale"]),
            valid,
            marks[valid[marks]],
        )


def _whole_heads(data: Path) -> Iterator[Task]:
    """An ICT face against whole ICT heads, whose first vertices are those of the face."""
    face = data / "ict_face/A_neutral.ply"
    if not face.exists():
        return
    source = read_mesh(face)
    count = len(source.mesh.vertices)
    every = np.ones(count, dtype=np.bool_)
    for path in sorted((data / "ict_full").glob("*.obj*")):
        name = path.name.split(".")[0]
        if name == "neutral":
            continue
        packed = path.read_bytes()
        head = read_mesh(gzip.decompress(packed) if path.suffix == ".gz" else packed)
        yield Task(
            "whole head",
            name,
            source,
            head,
            head.mesh.vertices[:count],
            1.0,
            every,
            _multi_pie(data),
        )


def _reduced(data: Path, group: str, noise: float, only: list[str] | None) -> Iterator[Task]:
    """ICT expressions of which half is missing, or of 2,000 vertices: several, and mixed ones."""
    mixed = sorted(f"ict_face/{path.stem}" for path in data.glob("ict_face/A_mixed_*.ply"))
    for seed, stem in enumerate([*SEVERAL, *mixed]):
        path = data / f"{stem}.ply"
        if not path.exists() or (only and not any(word in stem for word in only)):
            continue
        source, mesh = read_mesh(path.with_name("A_neutral.ply")), read_mesh(path).mesh
        count = 2_000 if group == "coarse" else 15_000
        target, turn, shift = remeshed(mesh, seed, noise, count=count)
        truth = mesh.vertices @ turn.T + shift
        valid = np.ones(len(truth), dtype=np.bool_)
        if group == "half missing":
            angle = seed * np.pi / 2 + 0.3
            side = turn @ np.array([np.cos(angle), np.sin(angle), 0.0])
            middle = float(np.median(truth @ side))
            valid = truth @ side < middle
            target = as_file(_part_of(target.mesh, target.mesh.vertices @ side < middle))
        marks = _multi_pie(data)
        yield Task(group, path.stem[2:], source, target, truth, 1.0, valid, marks[valid[marks]])


def _half_heads(data: Path, noise: float, only: list[str] | None) -> Iterator[Task]:
    """Halves of heads with pockets; judged is the skin on the piece that is used."""
    neutral, files = expression_files(data, "makehuman")
    if neutral is None:
        return
    source = read_mesh(neutral)
    skin = np.ones(len(source.mesh.vertices), dtype=np.bool_)
    for cavity in find_cavities(source.mesh, ambient_visibility(source.mesh)):
        skin[source.mesh.faces[cavity]] = False
    for seed, (name, path) in enumerate(files.items()):
        if only and not any(word in name for word in only):
            continue
        mesh = read_mesh(path).mesh
        dense, turn, shift = remeshed(mesh, seed, noise)
        truth = mesh.vertices @ turn.T + shift
        angle = seed * np.pi / 2 + 0.3
        side = turn @ np.array([np.cos(angle), np.sin(angle), 0.0])
        middle = float(np.median(truth @ side))
        target = as_file(_part_of(dense.mesh, dense.mesh.vertices @ side < middle))
        used = find_surface(target, ())[0].vertex_of >= 0
        nearest = KDTree(target.mesh.vertices).query(truth)[1]
        valid = skin & (truth @ side < middle) & used[nearest]
        marks = np.zeros(0, dtype=np.int64)
        yield Task("half head", name, source, target, truth, 1.0, valid, marks)


def _part_of(mesh: Mesh, keep: BoolArray) -> Mesh:
    used, flat = np.unique(mesh.faces[keep[mesh.faces].all(axis=1)], return_inverse=True)
    return Mesh(mesh.vertices[used], flat.reshape(-1, 3))
