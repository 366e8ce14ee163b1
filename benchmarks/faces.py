"""Expression pairs with ground truth: targets remeshed, shuffled and moved.

Needs a folder of same-topology sets (``ict_face/A_*.ply``, ``makehuman/*_skin_*.obj``,
``cartoon_toon/toon_skin_*.obj``) and the ``bench`` extra for remeshing.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pymeshlab

from engine.io import MeshFile, read_mesh
from engine.types import FloatArray, IntArray, Mesh


@dataclass(frozen=True)
class Pair:
    name: str
    source: MeshFile
    target: MeshFile
    truth: FloatArray  # (n, 3) the source's vertices on the target, in the target's frame
    expression: FloatArray  # the same in the source's frame
    landmarks: IntArray  # vertices to give as ``to``


SETS = {
    "ict_face": ("ict_face/A_*.ply", "A_"),
    "makehuman": ("makehuman/*_skin_*.obj", "_skin_"),
    "cartoon_toon": ("cartoon_toon/*_skin_*.obj", "_skin_"),
}
HEADS = {"makehuman_head": ("makehuman/*_head_*.obj", "_head_")}


def expression_files(data: Path, which: str) -> tuple[Path | None, dict[str, Path]]:
    """The files of one set: its neutral face if it is there, and its expressions by name."""
    pattern, before = (SETS | HEADS)[which]
    files = {path.stem.partition(before)[2]: path for path in sorted(data.glob(pattern))}
    return files.pop("neutral", None), files


def expressions(data: Path, which: str) -> tuple[Mesh, dict[str, FloatArray]]:
    """The neutral face of one set, and its vertices in each expression, by name."""
    neutral, files = expression_files(data, which)
    if neutral is None:
        raise FileNotFoundError(f"{data} has no neutral face of {which}")
    return read_mesh(neutral).mesh, {name: read_mesh(p).mesh.vertices for name, p in files.items()}


def pairs(
    data: Path, which: str, *, noise: float = 0.0, only: list[str] | None = None
) -> Iterator[Pair]:
    """All expressions of one set against its neutral face; none where the folder lacks the set.

    ``only``: words of which a name must have one.
    """
    neutral, files = expression_files(data, which)
    if neutral is None:
        return
    source = read_mesh(neutral)
    landmarks = inner_landmarks(neutral.parent, source)
    for seed, (name, path) in enumerate(files.items()):
        if only and not any(word in path.stem for word in only):
            continue
        expression = read_mesh(path).mesh
        target, turn, shift = remeshed(expression, seed, noise)
        yield Pair(
            name,
            source,
            target,
            expression.vertices @ turn.T + shift,
            expression.vertices,
            landmarks,
        )


def inner_landmarks(folder: Path, source: MeshFile) -> IntArray:
    """The 51 inner Multi-PIE landmarks where the set has them, else 51 spread vertices."""
    listed = folder / "landmarks.json"
    if listed.exists():
        return np.asarray(json.loads(listed.read_text())["multi_pie_68"][17:])
    return spread_vertices(source.mesh.vertices, 51)


def spread_vertices(vertices: FloatArray, count: int) -> IntArray:
    """Farthest points, from the one with largest z on."""
    chosen = [int(np.argmax(vertices[:, 2]))]
    nearest = np.linalg.norm(vertices - vertices[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, np.linalg.norm(vertices - vertices[chosen[-1]], axis=1))
    return np.asarray(chosen)


def remeshed(
    mesh: Mesh, seed: int, noise: float, *, count: int = 15_000
) -> tuple[MeshFile, FloatArray, FloatArray]:
    """The surface with another triangulation, shuffled, turned and shifted; how it was moved.

    ``count``: about how many vertices it gets.
    """
    corners = mesh.vertices[mesh.faces]
    area = (
        np.linalg.norm(
            np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
        ).sum()
        / 2
    )
    edge = float(np.sqrt(area / count / 0.866))
    work = pymeshlab.MeshSet()
    work.add_mesh(pymeshlab.Mesh(mesh.vertices, mesh.faces))
    work.meshing_isotropic_explicit_remeshing(
        iterations=6, targetlen=pymeshlab.PureValue(edge), featuredeg=30
    )
    made = work.current_mesh()
    vertices, faces = made.vertex_matrix(), made.face_matrix().astype(np.int64)
    random = np.random.default_rng(seed)
    used = np.unique(faces)
    order = random.permutation(used)
    place = np.full(len(vertices), -1)
    place[order] = np.arange(len(order))
    turn, shift = _random_motion(random, np.ptp(mesh.vertices, axis=0).max())
    moved = vertices[order] @ turn.T + shift + noise * random.normal(size=(len(order), 3))
    faces = place[faces][random.permutation(len(faces))]
    return as_file(Mesh(moved, faces)), turn, shift


def _random_motion(random: np.random.Generator, size: float) -> tuple[FloatArray, FloatArray]:
    axis = random.normal(size=3)
    axis /= np.linalg.norm(axis)
    angle = np.deg2rad(random.uniform(3, 12))
    cross = np.cross(np.eye(3), axis)
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return turn, random.normal(size=3) * 0.1 * size


def as_file(mesh: Mesh) -> MeshFile:
    """A mesh as the bytes of a PLY file, read back."""
    header = (
        "ply\nformat binary_little_endian 1.0\n"
        f"element vertex {len(mesh.vertices)}\n"
        "property double x\nproperty double y\nproperty double z\n"
        f"element face {len(mesh.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    rows = np.empty(len(mesh.faces), dtype=[("n", "u1"), ("v", "<i4", 3)])
    rows["n"], rows["v"] = 3, mesh.faces
    return read_mesh(header.encode() + mesh.vertices.astype("<f8").tobytes() + rows.tobytes())


def rigidly_aligned(points: FloatArray, onto: FloatArray) -> FloatArray:
    """``points`` moved by the best rotation and translation onto ``onto``."""
    turn, shift = rigid_motion(points, onto)
    return points @ turn.T + shift


def rigid_motion(points: FloatArray, onto: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The rotation (3, 3) and translation (3,) that bring ``points`` nearest to ``onto``."""
    here, there = points.mean(axis=0), onto.mean(axis=0)
    u, _, vt = np.linalg.svd((onto - there).T @ (points - here))
    turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ vt))]) @ vt
    return turn, there - turn @ here
