"""What the service adds to real edits, and how busy it keeps two workers with them.

``python -m benchmarks.overhead``: direct moves of one point of a face of 1500 vertices, through
``quasiface serve``. First one after another: the time from the POST to the end, less the engine's
own stages. Then many at once: the share of the time that the workers ran edits, and that the
engine's stages ran. ``benchmarks.queueing`` measures the same with edits that only sleep.

``python -m benchmarks.overhead DATA``: edits of the ICT face (9,409 vertices) towards three
targets of which each has other weights than the one before, or other ``moved_to``, and nothing
else, first for the meshes alone, then with all figures: from the POST to the end, by what hands
over to what, and by stages. Run ``quasiface warm``
before: a service that starts without compiled kernels loads them anew in every process.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import datetime
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from engine import read_mesh
from tests.acceptance.files import ply, small
from tests.service.killing import Stack, running

Json = dict[str, Any]
ONE_BY_ONE = 20
AT_ONCE = 40
WORKERS = 2
WARM = 4
TARGETS = ("smile", "jaw_open", "surprise")
SERVE = ("service.cli", "serve")
WHOLE = "POST to succeeded"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path, nargs="?")
    data = parser.parse_args().data
    print(f"load before: {os.getloadavg()[0]:.1f}")
    with (
        tempfile.TemporaryDirectory() as folder,
        running(Stack(Path(folder), SERVE)) as stack,
        httpx.Client(base_url=stack.url, timeout=600.0) as client,
    ):
        if data is not None:
            _again(client, stack, data / "ict_face")
        else:
            _moves(client)
    print(f"load after: {os.getloadavg()[0]:.1f}")


def _spent(stack: Stack) -> float:
    """Processor seconds of everything that serves, and of what it has waited for."""
    return sum(sum(one.cpu_times()[:4]) for one in stack.family())


def _again(client: httpx.Client, stack: Stack, faces: Path) -> None:
    """Edits of the same meshes that differ in weights, or in where points are on targets."""

    def sent(name: str) -> str:
        answer = client.post("/v1/meshes", content=(faces / f"A_{name}.ply").read_bytes())
        return answer.json()["id"]

    meshes = {
        "source": sent("neutral"),
        "targets": [{"mesh": sent(name), "name": name} for name in TARGETS],
    }
    landmarks = json.loads((faces / "landmarks.json").read_text())["multi_pie_68"][17:68:4]

    def weighted(number: int) -> Json:
        return {"weights": {"smile": 0.4 + 0.01 * number, "jaw_open": 0.3, "surprise": 0.2}}

    def moved(number: int, count: int, targets: Sequence[str]) -> Json:
        """Of 13 points that have a place on every target, ``count`` in another on ``targets``."""
        points = [{"at": {"vertex": at}, "to": _near(faces, at, TARGETS, 0)} for at in landmarks]
        for index in range(count):
            points[index]["moved_to"] = _near(faces, landmarks[index], targets, number + index)
        return weighted(0) | {"control_points": {"points": points, "auto": 289}}

    one, every = TARGETS[:1], len(landmarks)
    kinds: dict[str, Callable[[int], Json]] = {
        "other weights": lambda n: meshes | weighted(n),
        "a point moved on a target": lambda n: meshes | moved(n, 1, one),
        "13 on a target": lambda n: meshes | moved(n, every, one),
        "13 on 3 targets": lambda n: meshes | moved(n, every, TARGETS),
    }
    for kind, made in kinds.items():
        for figures in (False, True):
            output: Json = {"output": {"figures": figures}}
            title = f"{kind}, {'all figures' if figures else 'meshes alone'}"
            _series(client, stack, title, lambda n, m=made, o=output: m(n) | o)


def _near(faces: Path, vertex: int, targets: Sequence[str], number: int) -> Json:
    """Places on the targets beside a vertex; 0: at it."""
    places: Json = {}
    for name in targets:
        at = read_mesh(faces / f"A_{name}.ply").mesh.vertices[vertex]
        places[name] = {"position": (at + 0.05 * np.sin(number) * np.arange(3) / 2).tolist()}
    return places


def _series(client: httpx.Client, stack: Stack, title: str, made: Callable[[int], Json]) -> None:
    edits = [made(number) for number in range(1, ONE_BY_ONE + 10)]

    def edited() -> tuple[dict[str, float], Json]:
        began = time.time()
        answer = client.post("/v1/edits", json=edits.pop())
        answer.raise_for_status()
        ended = _ended(client, answer.json()["id"])
        seen = time.time()
        mesh = client.get(f"/v1/edits/{ended['id']}/results/edited.ply")
        mesh.raise_for_status()
        return _handed_over(began, ended, seen) | {
            "the mesh, downloaded": time.time() - seen
        }, ended

    first, ended = edited()
    print(f"{title}: the first {first[WHOLE]:.1f} s")
    while not ended["stages"][0]["cached"]:
        time.sleep(1.0)  # until one is kept open
        _, ended = edited()
    before = _spent(stack)
    runs = [edited() for _ in range(ONE_BY_ONE)]
    spent = (_spent(stack) - before) / ONE_BY_ONE
    print(f"  from an open edit; processor time of everything: {1000 * spent:.0f} ms")
    for name in runs[0][0]:
        _row(name, [parts[name] for parts, _ in runs])
    for index, stage in enumerate(runs[0][1]["stages"]):
        took = [edit["stages"][index]["seconds"] for _, edit in runs]
        if max(took) > 0.0:
            _row(f"  {stage['name']}{', cached' if stage['cached'] else ''}", took)


def _handed_over(began: float, edit: Json, seen: float) -> dict[str, float]:
    """Where the time went between the POST and the answer that says ``succeeded``."""
    created, started, finished = (
        datetime.fromisoformat(edit[when]).timestamp()
        for when in ("created_at", "started_at", "finished_at")
    )
    child = edit["summary"]["seconds"]
    return {
        WHOLE: seen - began,
        "POST until it is in the database": created - began,
        "until a worker begins": started - created,
        "the child": child,
        "the worker beside it: files, saving": finished - started - child,
        "until the client sees it": seen - finished,
    }


def _row(name: str, seconds: list[float]) -> None:
    print(f"    {name:38}{_median(seconds)}, least {1000 * min(seconds):.0f} ms")


def _moves(client: httpx.Client) -> None:
    face = small()
    sent = client.post("/v1/meshes", content=ply(face.vertices, face.faces))
    mesh = sent.json()["id"]
    for number in range(WARM):
        _ended(client, _start(client, mesh, number))
    _overhead(client, mesh)
    _busy(client, mesh)


def _start(client: httpx.Client, mesh: str, number: int) -> str:
    point = {"name": "point", "at": {"vertex": 100}, "move": [0.0, 0.1, 0.1 + 0.001 * number]}
    edit = {"source": mesh, "control_points": {"points": [point]}}
    answer = client.post("/v1/edits", json=edit)
    answer.raise_for_status()
    return answer.json()["id"]


def _ended(client: httpx.Client, edit_id: str) -> Json:
    edit: Json = {"status": "queued"}
    while edit["status"] in {"queued", "running"}:
        edit = client.get(f"/v1/edits/{edit_id}", params={"wait": 30}).json()
    assert edit["status"] == "succeeded", edit["error"]
    return edit


def _in_stages(edit: Json) -> float:
    return sum(stage["seconds"] for stage in edit["stages"])


def _overhead(client: httpx.Client, mesh: str) -> None:
    added: list[float] = []
    whole: list[float] = []
    for number in range(ONE_BY_ONE):
        began = time.perf_counter()
        edit = _ended(client, _start(client, mesh, WARM + number))
        whole.append(time.perf_counter() - began)
        added.append(whole[-1] - _in_stages(edit))
    print(
        f"{ONE_BY_ONE} one by one: POST to succeeded {_median(whole)}, "
        f"less the engine's stages {_median(added)}, most {1000 * max(added):.0f} ms"
    )


def _median(seconds: list[float]) -> str:
    return f"median {1000 * statistics.median(seconds):.0f} ms"


def _busy(client: httpx.Client, mesh: str) -> None:
    began = time.perf_counter()
    with ThreadPoolExecutor(4) as pool:
        ids = list(pool.map(lambda number: _start(client, mesh, 100 + number), range(AT_ONCE)))
    edits = [_ended(client, edit_id) for edit_id in ids]
    seconds = time.perf_counter() - began
    starts, ends = (
        [datetime.fromisoformat(edit[when]) for edit in edits]
        for when in ("started_at", "finished_at")
    )
    spans = zip(starts, ends, strict=True)
    attempts = sum((end - start).total_seconds() for start, end in spans)
    from_first_to_last = WORKERS * (max(ends) - min(starts)).total_seconds()
    stages = sum(_in_stages(edit) for edit in edits)
    print(
        f"{AT_ONCE} at once: {seconds:.1f} s; {WORKERS} workers busy with edits "
        f"{100 * attempts / from_first_to_last:.0f} %, with the engine's stages "
        f"{100 * stages / from_first_to_last:.0f} %"
    )


if __name__ == "__main__":
    main()
