"""What the service answers to every mesh file in a folder, and what an edit of each comes to.

``python -m benchmarks.awkward FOLDER``: uploads each PLY and OBJ file to a service of its own.
A file that is taken is edited towards the same face's smile (``NAME_smile`` beside ``NAME`` or
``NAME_neutral``); without one, towards ``--smile`` (the bundled one) if it is of about that size;
and else one point of it is moved. Prints a Markdown table; ends with 1 if anything answered 5xx.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import httpx
import numpy as np

from engine.errors import EngineError
from engine.io import read_mesh
from tests.faces import ICT_SMILE
from tests.service.killing import Stack, running

Json = dict[str, Any]
WORKERS = 2
SAME_SIZE = 0.25
MOVE = 0.03
EDIT_SECONDS = 900
SERVE = ("service.cli", "serve")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--smile", type=Path, default=ICT_SMILE)
    given = parser.parse_args()
    folder: Path = given.folder
    paths = sorted(path for path in folder.iterdir() if path.suffix in {".ply", ".obj"})
    with (
        tempfile.TemporaryDirectory() as data,
        running(Stack(Path(data), SERVE)) as stack,
        httpx.Client(base_url=stack.url, timeout=EDIT_SECONDS) as client,
        ThreadPoolExecutor(WORKERS) as pool,
    ):
        uploads = {path: upload(client, path) for path in paths}
        smile = upload(client, given.smile).json()
        taken = {path: sent.json() for path, sent in uploads.items() if sent.is_success}
        outcomes = pool.map(lambda path: edited(client, path, taken, smile), taken)
        edits = dict(zip(taken, outcomes, strict=True))
    print("| file | upload | edit |\n|---|---|---|")
    for path, sent in uploads.items():
        print(f"| {path.name} | {said(sent)} | {edits.get(path, '')} |")
    raise SystemExit(any(sent.status_code >= 500 for sent in uploads.values()))


def upload(client: httpx.Client, path: Path) -> httpx.Response:
    return client.post("/v1/meshes", params={"name": path.name}, content=path.read_bytes())


def said(sent: httpx.Response) -> str:
    """Status, and the warnings or the problem in full."""
    body = sent.json()
    if sent.is_success:
        handled = ", ".join(f"{one['code']} {one['count']}" for one in body["warnings"])
        return f"{sent.status_code} {handled or 'nothing unusual'}"
    problem = body["errors"][0]
    return f"{sent.status_code} `{problem['code']}` {problem['message']}"


def edited(client: httpx.Client, path: Path, taken: Mapping[Path, Json], usual_smile: Json) -> str:
    """One edit of an uploaded file, and what came of it."""
    kind, document = edit_of(path, taken, usual_smile)
    answer = client.post("/v1/edits", json=document)
    if answer.status_code != 202:
        return f"{kind}: {said(answer)}"
    address = f"/v1/edits/{answer.json()['id']}"
    edit = answer.json()
    while edit["status"] in {"queued", "running"}:
        edit = client.get(address, params={"wait": 30}).json()
    if edit["status"] != "succeeded":
        problem = edit["error"]["errors"][0]
        return f"{kind}: {edit['status']} `{problem['code']}` {problem['message']}"
    report = client.get(f"{address}/results/report.json").json()
    folds = sum(frame["iteration"]["folds"] for frame in report["frames"])
    (name,) = [one["name"] for one in edit["results"] if one["role"] == "mesh"]
    same = own_layout(path.read_bytes(), client.get(f"{address}/results/{name}").content)
    distances = [
        f"{target['distance']['result_to_target']['mean']:.2g} from the target"
        for target in report["targets"].values()
    ]
    parts = [*distances, f"{folds} folds", same, f"{edit['summary']['seconds']:.0f} s"]
    return f"{kind}: {', '.join(parts)}"


def edit_of(path: Path, taken: Mapping[Path, Json], usual_smile: Json) -> tuple[str, Json]:
    mesh = taken[path]
    stem = path.stem.removesuffix("_neutral")
    smile = taken.get(path.with_stem(f"{stem}_smile"))
    kind = "to its smile"
    if smile is None and abs(_diagonal(mesh) / _diagonal(usual_smile) - 1) < SAME_SIZE:
        smile, kind = usual_smile, "to the usual smile"
    if smile is not None and smile["id"] != mesh["id"]:
        return kind, {"source": mesh["id"], "targets": [{"mesh": smile["id"], "name": "smile"}]}
    front = np.mean(mesh["bounding_box"], axis=0)
    at = {"position": front.tolist(), "max_snap": _diagonal(mesh)}
    point = {"name": "point", "at": at, "move": [0.0, 0.0, MOVE * _diagonal(mesh)]}
    return "one point moved", {"source": mesh["id"], "control_points": {"points": [point]}}


def _diagonal(mesh: Json) -> float:
    low, high = mesh["bounding_box"]
    return float(np.linalg.norm(np.subtract(high, low)))


def own_layout(before: bytes, after: bytes) -> str:
    """Whether the result differs from the file in vertex positions only, as far as is read."""
    try:
        one, other = read_mesh(before), read_mesh(after)
    except EngineError as error:
        return f"the result cannot be read: {error}"
    faces: Sequence[bool] = [
        one.format == other.format,
        np.array_equal(one.mesh.faces, other.mesh.faces),
        np.array_equal(one.polygon_of, other.polygon_of),
        len(one.mesh.vertices) == len(other.mesh.vertices),
    ]
    return "same layout" if all(faces) else "ANOTHER LAYOUT"


if __name__ == "__main__":
    main()
