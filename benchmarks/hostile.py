"""What it costs to read and to inspect large files that were made to cost much.

``python -m benchmarks.hostile [MEGABYTES] [--only NAME …]``: for each kind of file, in a process of
its own, CPU seconds and peak memory of reading it and of the inspection that an upload gets, as a
Markdown table. Memory counts the file's own bytes.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import re
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from engine.errors import EngineError
from engine.io import read_mesh
from service.jobs import inspect_mesh, load_kept_kernels
from service.jobtypes import InspectJob
from tests.acceptance.files import ply

Make = Callable[[int], bytes]
POINTS = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
TRIANGLE = POINTS + b"f 1 2 3\n"
AXES = b"".join(b"property float %c\n" % axis for axis in b"xyz")
FACES = b"property list uchar int vertex_indices\nend_header\n"
SMALL = 200_000


def again(unit: bytes, before: bytes = b"", after: bytes = b"") -> Make:
    return lambda size: before + unit * (size // len(unit)) + after


def rows(line: bytes) -> Make:
    """A text PLY of one vertex again and again."""
    header = b"ply\nformat ascii 1.0\nelement vertex %d\n" + AXES + b"element face 1\n" + FACES
    return lambda size: (header % (size // len(line))) + line * (size // len(line)) + b"3 0 1 2\n"


def random_faces(vertices: int) -> Make:
    """Triangles between any three of so many vertices."""

    def make(size: int) -> bytes:
        chance = np.random.default_rng(0)
        count = max((size - 12 * vertices) // 13, 1)
        faces = chance.integers(0, vertices, (count, 3))
        return ply(chance.normal(size=(vertices, 3)), faces)

    return make


def fan(size: int) -> bytes:
    """A face for every third of the bytes of one edge's neighbours."""
    pages = size // 25
    angle = np.linspace(0, 6, pages)
    around = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    vertices = np.concatenate([[[0, 0, 0], [0, 0, 1]], around])
    hinge = np.tile([0, 1], (pages, 1))
    return ply(vertices, np.column_stack([hinge, np.arange(pages) + 2]))


def apart(size: int) -> bytes:
    """Triangles that have nothing to do with each other."""
    count = size // 49
    vertices = np.random.default_rng(0).uniform(-9, 9, (3 * count, 3))
    return ply(vertices, np.arange(3 * count).reshape(-1, 3))


def strips(size: int) -> bytes:
    """Pairs of triangles that have nothing to do with each other."""
    count = size // 74
    corners = np.arange(4 * count).reshape(-1, 4)
    vertices = np.random.default_rng(0).uniform(-9, 9, (4 * count, 3))
    return ply(vertices, np.concatenate([corners[:, :3], corners[:, [1, 3, 2]]]))


KINDS: dict[str, Make] = {
    "random bytes": lambda size: np.random.default_rng(0).bytes(size),
    "NUL": bytes,
    "words": again(b"junk\n"),
    "one word": again(b"a"),
    "empty comments": again(b"#\n"),
    "continued lines": again(b"\\\n"),
    "keywords alone: f": again(b"f\n", POINTS),
    "keywords alone: vn": again(b"vn\n", TRIANGLE),
    "unknown keywords": again(b"q\n", TRIANGLE),
    "one number": lambda size: b"v " + b"9" * size,
    "numbers of 23 digits": again(b"v 0.12345678901234567890123 2 3\n", after=b"f 1 2 3\n"),
    "numbers of 500 digits": again(b"v 0." + b"1" * 500 + b" 2 3\n", after=b"f 1 2 3\n"),
    "numbers too large": again(b"v 1e300 1e300 1e300\n"),
    "numbers too small": again(b"v 1e-310 1e-310 1e-310\n", after=b"f 1 2 3\n"),
    "numbers halfway": again(b"v 9007199254740993 0 0\n", after=b"f 1 2 3\n"),
    "NaN": again(b"v nan nan nan\n"),
    "infinity": again(b"v infinity 0 0\n"),
    "1.#QNAN": again(b"v 1.#IND 1.#QNAN 0\n"),
    "words for numbers": again(b"v a b c\n", after=b"f 1 2 3\n"),
    "one point": again(b"v 0 0 0\n", after=b"f 1 2 3\n"),
    "points only": again(b"v 1 2 3\n"),
    "indices out of range": again(b"f 1 2 9\n", POINTS),
    "indices too large": again(b"f 99999999999999999999 1 2\n", POINTS),
    "a broken face at the end": again(b"f 1 2 3\n", POINTS, b"f a\n"),
    "one face": again(b" 1", POINTS + b"f"),
    "large faces": again(b"f" + b" 1 2 3" * 100 + b"\n", POINTS),
    "one face again and again": again(b"f 1 2 3\n", POINTS),
    "the same with slashes": again(b"f 1/ 2// 3/\n", POINTS),
    "rows of text": rows(b"0 0 0\n"),
    "rows of 23 digits": rows(b"0.12345678901234567890123 2 3\n"),
    "rows of NaN": rows(b"nan nan nan\n"),
    "rows of words": rows(b"a b c\n"),
    "rows that are longer": rows(b"0 0 0 7\n"),
    "a header of 2^31 rows": again(
        b"0 0 0\n",
        b"ply\nformat ascii 1.0\nelement vertex 2147483648\n" + AXES + b"element face 1\n" + FACES,
    ),
    "a header of comments": again(b"comment x\n", b"ply\n"),
    "random triangles, few vertices": random_faces(2_000),
    "random triangles": random_faces(2_000_000),
    "triangles at one edge": fan,
    "triangles apart": apart,
    "pairs of triangles apart": strips,
    "UTF-16": again("v 0 0 0\n".encode("utf-16-le")),
    "brackets": again(b"["),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("megabytes", type=int, nargs="?", default=100)
    parser.add_argument("--only", nargs="*", default=list(KINDS))
    given = parser.parse_args()
    print(f"load before: {os.getloadavg()[0]:.1f}\n")
    print("| file | read: s | × file | inspected: s | × file | answer |\n|---|---|---|---|---|---|")
    context = multiprocessing.get_context("spawn")
    with tempfile.TemporaryDirectory() as folder:
        for name in given.only:
            path = Path(folder) / "file"
            path.write_bytes(KINDS[name](1_000_000 * given.megabytes))
            for work in (read, inspect):
                child = context.Process(target=measure, args=(name, path, work))
                child.start()
                child.join()
                if child.exitcode:
                    print(f" ended with {child.exitcode} | ", end="")
    print(f"\nload after: {os.getloadavg()[0]:.1f}")


def measure(name: str, path: Path, work: Callable[[Path], str]) -> None:
    """A part of the row, printed by the process that did the work."""
    load_kept_kernels()
    size = path.stat().st_size
    small = path.with_name("small")
    with path.open("rb") as file:
        small.write_bytes(file.read(SMALL))
    work(small)
    Path("/proc/self/clear_refs").write_text("5")
    before = resident("VmRSS")
    began = time.process_time()
    answer = work(path)
    seconds = time.process_time() - began
    times = (resident("VmHWM") - before) / size
    if work is read:
        print(f"| {name} | {seconds:.1f} | {times:.1f} | ", end="", flush=True)
    else:
        print(f"{seconds:.1f} | {times:.1f} | {answer} |", flush=True)


def resident(which: str) -> int:
    found = re.search(rf"{which}:\s+(\d+) kB", Path("/proc/self/status").read_text())
    assert found
    return 1024 * int(found[1])


def read(path: Path) -> str:
    return outcome(lambda: ",".join(each.code for each in read_mesh(path).warnings))


def inspect(path: Path) -> str:
    def warnings() -> str:
        found = inspect_mesh(InspectJob(path), lambda _: None)
        return ", ".join(f"{each['code']} {each['count']}" for each in found["warnings"])

    return outcome(warnings)


def outcome(work: Callable[[], str]) -> str:
    try:
        return f"taken: {work() or 'nothing unusual'}"
    except EngineError as error:
        return f"refused: `{error.code}`"
    except MemoryError:
        return "out of memory"


if __name__ == "__main__":
    main()
