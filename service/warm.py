"""``quasiface warm``: compile every kernel before the first request has to wait for it.

Runs the jobs of the service on a small generated face. Machine code is kept where numba finds it
again: beside the engine's source, or in ``NUMBA_CACHE_DIR``.
"""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from engine.io import read_mesh, write_mesh
from service.jobs import inspect_mesh, run_edit, snap_points, validate_edit
from service.jobtypes import EditJob, InspectJob, Json, SnapJob, ValidateJob
from service.schemas import EditDocument

_Holes = tuple[tuple[tuple[int, int], tuple[int, int]], ...]
_RINGS = 40
_SECTORS = 96
_HOLES: _Holes = (((15, 21), (12, 22)), ((15, 21), (26, 36)), ((15, 23), (65, 79)))
"""Rings and sectors that are left out: two eyes and a mouth."""
_GAPING: _Holes = (((4, 36), (43, 95)),)
_PAPER = dict.fromkeys(
    (
        *("registration", "correspondence", "parameterization", "iteration"),
        *("restoration", "outer_boundary", "passengers"),
    ),
    "paper",
)


def warm(tell: Callable[[str], None]) -> None:
    """Run small edits with every choice of method, and say how long each took."""
    with tempfile.TemporaryDirectory(prefix="quasiface-") as folder:
        meshes = _meshes(Path(folder))
        for name, work in _jobs(Path(folder), meshes):
            began = time.perf_counter()
            work()
            tell(f"{name}: {time.perf_counter() - began:.1f} s")


def _jobs(folder: Path, meshes: Mapping[str, Path]) -> Iterator[tuple[str, Callable[[], object]]]:
    for name, path in meshes.items():
        yield f"inspect {name}", lambda path=path: inspect_mesh(InspectJob(path), _silent)
    points = [{"name": None, "at": point["at"]} for point in _moves()]
    yield "snap", lambda: snap_points(SnapJob(meshes["rest.ply"], points), _silent)
    for name, wanted in _edits().items():
        document = EditDocument.model_validate(wanted).model_dump(mode="json")
        yield (
            f"validate {name}",
            lambda document=document: validate_edit(ValidateJob(document, meshes), _silent),
        )
        for again in ("", ", again"):
            out = folder / f"{name}{again}"
            out.mkdir()
            job = EditJob(name, document, meshes, out, folder / "cache")
            yield f"edit {name}{again}", lambda job=job: run_edit(job, _silent)


def _edits() -> dict[str, Json]:
    every = {"formats": ["source", "obj", "ply", "glb"]}
    smile = {"source": "rest.ply", "targets": [{"mesh": "smile.ply", "name": "smile"}]}
    auto = {"auto": 12}
    given = {"points": [{"at": {"vertex": 200}, "to": {"smile": {"vertex": 200}}}], "auto": 12}
    return {
        "by default": {**smile, "frames": 3, "output": every},
        "with given points": {**smile, "control_points": given, "weights": {"smile": 0.5}},
        "with weights beyond": {
            **smile,
            "weights": {"smile": 1.4},
            "control_points": {
                "points": [{"at": {"vertex": 200}, "weights": {"smile": 1.2}}],
                "auto": 12,
            },
        },
        "of a rotated copy": {
            "source": "rest.obj",
            "targets": [{"mesh": "turned.obj", "name": "turned"}],
            "output": every,
        },
        "of creases": {
            "source": "rest.obj",
            "targets": [{"mesh": "creased.obj", "name": "creased"}],
        },
        "as in the paper": {**smile, "control_points": auto, "options": _PAPER},
        "by a Teichmüller map": {
            **smile,
            "control_points": auto,
            "options": {"iteration": "teichmueller", "outer_boundary": "fixed"},
        },
        "with kept holes, sliding": {
            **smile,
            "control_points": auto,
            "options": {"holes": "kept", "outer_boundary": "sliding", "iteration": "minimal"},
        },
        "by moves": {"source": "rest.ply", "control_points": {"points": _moves()}},
        "of a spike": {"source": "spike.obj", "control_points": {"points": _moves()}},
        "by far moves": {"source": "rest.ply", "control_points": {"points": _moves(9.0)}},
        "of a closed surface": {"source": "closed.obj", "control_points": {"points": _moves()}},
        "by moves, as in the paper": {
            "source": "rest.obj",
            "control_points": {"points": _moves()},
            "options": _PAPER,
        },
    }


def _moves(far: float = 0.2) -> list[Json]:
    middle = {"polygon": 150, "barycentric": [0.2, 0.3, 0.5]}
    return [
        {"at": {"vertex": 200}, "move": [0.0, far, 0.1]},
        {"at": middle, "move": [0.0, 0.0, 0.1]},
        {"at": {"position": [2.0, 7.0, 8.0], "max_snap": 5.0}, "fixed": True},
    ]


def _meshes(folder: Path) -> dict[str, Path]:
    texts = {
        "rest.obj": _obj(),
        "smile.obj": _obj(smile=1.0),
        "turned.obj": _obj(smile=0.7, turn=0.8),
        "creased.obj": _obj(smile=8.0, turn=0.8, spike=6.0),
        "spike.obj": _obj(spike=20.0),
        "closed.obj": _obj(holes=(), closed=True),
        "gaping.obj": _obj(holes=_GAPING),
        "text.ply": _text_ply(_obj()),
    }
    made = {name: folder / name for name in (*texts, "rest.ply", "smile.ply")}
    for name, text in texts.items():
        made[name].write_text(text)
    for name in ("rest", "smile"):
        made[f"{name}.ply"].write_bytes(write_mesh(read_mesh(made[f"{name}.obj"]), format="ply"))
    return made


def _text_ply(obj: str) -> str:
    vertices = [line[2:] for line in obj.splitlines() if line.startswith("v ")]
    corners = [line.split()[1:] for line in obj.splitlines() if line.startswith("f ")]
    faces = [[int(corner.split("/")[0]) - 1 for corner in face] for face in corners]
    header = ["ply", "format ascii 1.0", f"element vertex {len(vertices)}"]
    header += [f"property double {axis}" for axis in "xyz"]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header"]
    rows = [" ".join(map(str, (len(face), *face))) for face in faces]
    return "\n".join((*header, *vertices, *rows)) + "\n"


def _obj(
    *,
    smile: float = 0.0,
    turn: float = 0.0,
    spike: float = 0.0,
    holes: _Holes = _HOLES,
    closed: bool = False,
) -> str:
    """A domed, bumpy disk with holes and an eyeball, as OBJ with normals."""
    places = [(0, 0), *((ring, s) for ring in range(1, _RINGS + 1) for s in range(_SECTORS))]
    vertices = [
        _place(ring / _RINGS, 2 * math.pi * s / _SECTORS, smile, spike) for ring, s in places
    ]
    faces = list(_faces(holes, closed))
    vertices += [(0.0, 0.0, -5.0)] * closed
    first = len(vertices) + 1
    ball = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    ball += [(-x, -y, -z) for x, y, z in ball]
    vertices += [(3.2 + x, 2.8 + y, 6.0 + z) for x, y, z in ball]
    octants = ((0, 1, 2), (1, 3, 2), (3, 4, 2), (4, 0, 2), (1, 0, 5), (3, 1, 5), (4, 3, 5))
    faces += [(first + a, first + b, first + c) for a, b, c in (*octants, (0, 4, 5))]
    c, s = math.cos(turn), math.sin(turn)
    turned = [(c * x + s * z, y, c * z - s * x) for x, y, z in vertices]
    lines = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in turned]
    lines += ["vn 0 0 1"] * len(turned)
    lines += ["f " + " ".join(f"{v}//{v}" for v in face) for face in faces]
    return "\n".join(lines) + "\n"


def _place(radius: float, angle: float, smile: float, spike: float) -> tuple[float, float, float]:
    x, y = 8 * radius * math.cos(angle), 10 * radius * math.sin(angle)
    nose = 2.0 * math.exp(-(x**2 + (y - 0.5) ** 2) / 3)
    cheeks = sum(math.exp(-((x - side) ** 2 + (y + 3) ** 2) / 4) for side in (-3.0, 3.0))
    bumps = 0.1 * math.sin(2.1 * x) * math.cos(1.7 * y)
    mouth = 0.8 * smile * math.exp(-((y + 4) ** 2) / 4)
    depth = 8 * (1 - 0.8 * radius**2) + nose + bumps + 0.7 * smile * cheeks
    depth += spike * max(0.0, 1 - 3 * radius)
    return x * (1 + 0.1 * mouth), y + mouth * (x / 4) ** 2 / (1 + (x / 4) ** 2), depth


def _faces(holes: _Holes, closed: bool) -> Iterator[tuple[int, ...]]:
    """Corners from 1: a fan in the middle, then quadrilaterals ring by ring.

    ``closed`` closes the rim with one more vertex.
    """

    def vertex(ring: int, sector: int) -> int:
        return 2 + (ring - 1) * _SECTORS + sector % _SECTORS

    for sector in range(_SECTORS):
        yield 1, vertex(1, sector), vertex(1, sector + 1)
        for ring in range(1, _RINGS):
            if not _in_hole(holes, ring, sector):
                near = (vertex(ring + 1, sector), vertex(ring + 1, sector + 1))
                yield vertex(ring, sector), *near, vertex(ring, sector + 1)
        if closed:
            yield vertex(_RINGS, sector + 1), vertex(_RINGS, sector), 2 + _RINGS * _SECTORS


def _in_hole(holes: _Holes, ring: int, sector: int) -> bool:
    return any(
        rings[0] <= ring < rings[1] and sectors[0] <= sector < sectors[1]
        for rings, sectors in holes
    )


def _silent(event: dict[str, Any]) -> None:
    """Nobody listens."""
