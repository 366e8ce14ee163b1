"""How long reading and patching a large file takes, with trimesh's times beside it.

``python -m benchmarks.files [COUNT]``: a curved sheet of COUNT (default 1,000,000) vertices and
twice as many triangles, as OBJ (plain, with texture coordinates, with normals) and as binary PLY.
A patch moves every vertex; trimesh, which cannot patch, writes the mesh anew. CPU seconds, the
best of three, in one thread.
"""

from __future__ import annotations

import argparse
import io
import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import trimesh

from engine.io import read_mesh, write_mesh
from engine.types import FloatArray, IntArray
from tests.acceptance.files import ply

REPEATS = 3
MOVE = (0.01, 0.02, 0.03)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=1_000_000)
    vertices, faces, uv, normals = sheet(parser.parse_args().count)
    print(f"load before: {os.getloadavg()[0]:.1f}")
    print(f"{len(vertices):,} vertices, {len(faces):,} triangles\n")
    print("| file | MB | read | patched | trimesh: read | trimesh: written |")
    print("|---|---|---|---|---|---|")
    points, corners = rows("v %.6f %.6f %.6f\n", vertices), faces + 1
    plain = rows("f %d %d %d\n", corners)
    textured = rows("f %d/%d %d/%d %d/%d\n", np.repeat(corners, 2, axis=1))
    shaded = rows("f %d//%d %d//%d %d//%d\n", np.repeat(corners, 2, axis=1))
    measure("OBJ", "obj", points + plain)
    measure("OBJ with UV", "obj", points + rows("vt %.6f %.6f\n", uv) + textured)
    measure("OBJ with normals", "obj", points + rows("vn %.4f %.4f %.4f\n", normals) + shaded)
    measure("binary PLY", "ply", ply(vertices, faces))
    print(f"\nload after: {os.getloadavg()[0]:.1f}")


def sheet(count: int) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
    """Vertices (n, 3), faces (m, 3), texture coordinates (n, 2) and normals (n, 3) of a bulge."""
    side = round(count**0.5)
    u, v = np.meshgrid(np.linspace(-8, 8, side), np.linspace(-10, 10, side))
    noise = np.random.default_rng(0).normal(0, 1e-4, (side * side, 3))
    vertices = np.stack([u, v, 10 - 0.05 * (u**2 + v**2)], axis=-1).reshape(-1, 3) + noise
    at = np.arange(side * side).reshape(side, side)
    a, b, c, d = (x.ravel() for x in (at[:-1, :-1], at[:-1, 1:], at[1:, 1:], at[1:, :-1]))
    faces = np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1)
    normals = np.stack([0.1 * u, 0.1 * v, np.ones_like(u)], axis=-1).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    uv = np.stack([(u + 8) / 16, (v + 10) / 20], axis=-1).reshape(-1, 2)
    return vertices, faces.reshape(-1, 3), uv, normals


def rows(line: str, table: FloatArray | IntArray) -> bytes:
    return (line * len(table) % tuple(table.reshape(-1).tolist())).encode()


def measure(name: str, kind: str, data: bytes) -> None:
    read_mesh(data)
    read, file = best(lambda: read_mesh(data))
    moved = file.mesh.vertices + MOVE
    write_mesh(file, moved)
    patched, _ = best(lambda: write_mesh(file, moved))

    def load() -> Any:
        return trimesh.load_mesh(io.BytesIO(data), file_type=kind, process=False)

    theirs, mesh = best(load)
    written, _ = best(lambda: mesh.export(file_type=kind))
    times = " | ".join(f"{seconds:.2f} s" for seconds in (read, patched, theirs, written))
    print(f"| {name} | {len(data) / 1e6:.0f} | {times} |", flush=True)


def best(work: Callable[[], Any]) -> tuple[float, Any]:
    """Seconds of the fastest of some runs, and what the last one gave."""
    fastest, result = float("inf"), None
    for _ in range(REPEATS):
        began = time.process_time()
        result = work()
        fastest = min(fastest, time.process_time() - began)
    return fastest, result


if __name__ == "__main__":
    main()
