"""Surfaces to map onto the disk: bundled faces, folders of them, expressions combined, refined."""

from __future__ import annotations

import gzip
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.faces import SETS, expression_files
from engine.errors import EngineError
from engine.io import read_mesh
from engine.topology import boundary_loops, disk_surface, editable_surface
from engine.topology._filling import HoleFiller
from engine.types import DiskSurface, Mesh, Surface

BUNDLED = Path(__file__).parent.parent / "examples"


def files(folder: Path) -> Iterator[tuple[str, Surface]]:
    """Every mesh file under a folder, packed ones too, that holds an editable surface."""
    for path in sorted(folder.rglob("*")):
        if path.name.endswith((".ply", ".obj", ".obj.gz", ".ply.gz")):
            data = path.read_bytes()
            data = gzip.decompress(data) if path.suffix == ".gz" else data
            try:
                surface, _ = editable_surface(read_mesh(data).mesh)
            except EngineError:
                continue
            yield str(path.relative_to(folder)), surface


def combinations(folder: Path, count: int, seed: int = 0) -> Iterator[tuple[str, Surface]]:
    """Neutral faces plus all expressions of their set, weighted at random in [-0.5, 1.5]."""
    random = np.random.default_rng(seed)
    sets = []
    for which in SETS:
        neutral, files = expression_files(folder, which)
        if neutral and files:
            rest = read_mesh(neutral).mesh
            others = [read_mesh(path).mesh.vertices for path in files.values()]
            sets.append((which, rest, np.stack(others) - rest.vertices))
    for number in range(count if sets else 0):
        name, rest, moves = sets[number % len(sets)]
        weights = random.uniform(-0.5, 1.5, len(moves))
        mesh = rest.moved(rest.vertices + np.tensordot(weights, moves, 1))
        yield f"{name} {number}", editable_surface(mesh)[0]


def closed(surface: Surface) -> Surface | None:
    """A head whose neck is its only loop, closed there; None for other surfaces."""
    if len(surface.loops) != 1 or not 4 < len(surface.loops[0]) < 100:
        return None
    filler = HoleFiller(surface.mesh.vertices, surface.mesh.faces, list(surface.loops))
    faces = np.concatenate([surface.mesh.faces, filler.fill(surface.loops[0])])
    return editable_surface(Mesh(surface.mesh.vertices, faces))[0]


def fan_filled(surface: Surface) -> DiskSurface:
    """The surface's holes closed by triangles around their centroids, as most tools do it."""
    vertices, faces = [surface.mesh.vertices], [surface.mesh.faces]
    count = len(surface.mesh.vertices)
    for at, loop in enumerate(surface.loops[1:], start=count):
        vertices.append(surface.mesh.vertices[loop].mean(axis=0)[None])
        faces.append(np.stack([np.roll(loop, -1), loop, np.full(len(loop), at)], axis=1))
    vertex = np.concatenate([np.arange(count), np.full(len(vertices) - 1, -1)])
    mesh = Mesh(np.concatenate(vertices), np.concatenate(faces))
    return DiskSurface(mesh, surface.loops[0], vertex, np.arange(len(surface.mesh.faces)))


def fillings(surface: Surface) -> Iterator[tuple[str, DiskSurface]]:
    """The disk with holes of minimal area closed and, if there are any, with fans, and kept."""
    yield "minimal", disk_surface(surface)
    if len(surface.loops) > 1:
        yield "fans", fan_filled(surface)
        yield "kept", disk_surface(surface, holes="kept")


def refined(mesh: Mesh, parts: int) -> DiskSurface:
    """Every side of a disk's triangles in ``parts`` parts, nothing moved; all of it surface."""
    rows, columns = np.nonzero(np.add.outer(np.arange(parts + 1), np.arange(parts + 1)) <= parts)
    weights = np.stack([rows, columns, parts - rows - columns], axis=1)
    points = np.einsum("wk,fkx->fwx", weights / parts, mesh.vertices[mesh.faces])
    corner = np.where(weights > 0, mesh.faces[:, None], -1)
    order = np.argsort(corner, axis=2)
    corner = np.take_along_axis(corner, order, axis=2) + 1
    share = np.take_along_axis(np.broadcast_to(weights, corner.shape), order, axis=2)
    key = corner[..., 0]
    for digit, base in (
        (corner[..., 1], len(mesh.vertices) + 1),
        (corner[..., 2], len(mesh.vertices) + 1),
        (share[..., 1] * (parts + 1) + share[..., 2], (parts + 1) ** 2),
    ):
        key = np.unique(key, return_inverse=True)[1].reshape(key.shape) * base + digit
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    place = np.full((parts + 2, parts + 2), -1)
    place[rows, columns] = np.arange(len(rows))
    low = rows + columns < parts
    i, j = rows[low], columns[low]
    upright = np.stack([place[i + 1, j], place[i, j + 1], place[i, j]], axis=1)
    turned = np.stack([place[i + 1, j + 1], place[i, j + 1], place[i + 1, j]], axis=1)
    small = np.concatenate([upright, turned[turned[:, 0] >= 0]])
    faces = number.reshape(len(mesh.faces), -1)[:, small].reshape(-1, 3)
    vertices = points.reshape(-1, 3)[first]
    loop = boundary_loops(faces, len(vertices))[0]
    every = Mesh(vertices, faces)
    return DiskSurface(every, loop, np.arange(len(vertices)), np.arange(len(faces)))
