"""``quasiface demo``: the service at work on bundled faces, from upload to downloaded results."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import httpx
from httpx_sse import connect_sse
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

Json = dict[str, Any]
START_SECONDS = 120.0
STOP_SECONDS = 30.0


class DemoError(RuntimeError):
    """The demo cannot go on; says why."""


def run_demo(document: Path, out: Path) -> None:
    """Start a service, edit what ``document`` names, download everything to ``out``, stop.

    ``document`` is an edit document with file names (beside it) in place of mesh ids.
    """
    console = Console()
    out.mkdir(parents=True, exist_ok=True)
    port = _free_port()
    server = _start(port, out / ".service")
    try:
        with httpx.Client(base_url=f"http://127.0.0.1:{port}", timeout=60.0) as client:
            _wait_until_ready(client, server)
            edit = _edit(client, console, document)
            report = _download(client, console, edit, out)
        console.print(_table(edit, report))
    finally:
        _stop(server)
    console.print(f"Results are in [bold]{out}[/]: open morph.glb, plane.png, histogram.png")


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _start(port: int, data: Path) -> subprocess.Popen[bytes]:
    log = data.with_suffix(".log")
    command = [sys.executable, "-m", "service.cli", "serve", "--port", str(port)]
    with log.open("wb") as sink:
        return subprocess.Popen(
            [*command, "--data-dir", str(data)], stdout=sink, stderr=subprocess.STDOUT
        )


def _wait_until_ready(client: httpx.Client, server: subprocess.Popen[bytes]) -> None:
    deadline = time.monotonic() + START_SECONDS
    while time.monotonic() < deadline:
        if server.poll() is not None:
            raise DemoError(f"the service ended with code {server.returncode}; see its log")
        try:
            if client.get("/readyz").is_success:
                return
        except httpx.TransportError:
            pass
        time.sleep(0.1)
    raise DemoError(f"the service was not ready within {START_SECONDS:g} seconds")


def _edit(client: httpx.Client, console: Console, path: Path) -> Json:
    """Upload the meshes, post the edit, follow its events; the finished edit."""
    document: Json = json.loads(path.read_text())
    document["source"] = _upload(client, console, path.parent / document["source"])
    for target in document["targets"]:
        target["mesh"] = _upload(client, console, path.parent / target["mesh"])
    answer = _checked(client.post("/v1/edits", json=document))
    console.print(f"Edit [bold]{answer['id']}[/] accepted")
    _follow(client, console, answer["links"]["events"])
    edit = _checked(client.get(f"/v1/edits/{answer['id']}", params={"wait": 10}))
    if edit["status"] != "succeeded":
        raise DemoError(f"the edit {edit['status']}: {json.dumps(edit.get('error'), indent=1)}")
    return edit


def _upload(client: httpx.Client, console: Console, path: Path) -> str:
    with path.open("rb") as file:
        mesh = _checked(client.post("/v1/meshes", files={"file": (path.name, file)}))
    console.print(
        f"Uploaded {path.name}: {mesh['vertices']} vertices, {mesh['triangles']} triangles, "
        f"{mesh['boundary_loops']} boundary loops"
    )
    return str(mesh["id"])


def _checked(response: httpx.Response) -> Json:
    if response.is_error:
        raise DemoError(f"{response.request.url} answered {response.status_code}: {response.text}")
    return response.json()


def _follow(client: httpx.Client, console: Console, href: str) -> None:
    """Show the event stream as it comes; it ends when the edit ends."""
    columns = (TextColumn("{task.description:>16}"), BarColumn(), TimeElapsedColumn())
    with (
        Progress(*columns, console=console) as progress,
        connect_sse(client, "GET", href, timeout=600.0) as stream,
    ):
        bars: dict[str, Any] = {}
        for event in stream.iter_sse():
            if not event.data:
                continue
            data: Json = event.json()
            name = data.get("name")
            if event.event == "status" or not name:
                continue
            if name not in bars:
                bars[name] = progress.add_task(name, total=1.0)
            progress.update(bars[name], completed=data.get("progress", 0.0))


def _download(client: httpx.Client, console: Console, edit: Json, out: Path) -> Json:
    results = _checked(client.get(edit["links"]["results"], params={"limit": 200}))["items"]
    for result in results:
        with (
            client.stream("GET", result["href"]) as response,
            (out / result["name"]).open("wb") as file,
        ):
            response.raise_for_status()
            for chunk in response.iter_bytes():
                file.write(chunk)
    console.print(f"Downloaded {len(results)} files")
    return json.loads((out / "report.json").read_text())


def _table(edit: Json, report: Json) -> Table:
    table = Table(title="What the edit did", show_header=False, title_justify="left")
    rows = [("control points", str(len(report["control_points"])))]
    rows += [("frames", str(len(report["frames"])))]
    if edit["document"]["output"]["figures"]:
        rows += _figures(report)
    for stage in edit["stages"]:
        kept = " (cached)" if stage.get("cached") else ""
        rows.append((f"{stage['name']}, seconds", f"{stage['seconds'] or 0.0:.2f}{kept}"))
    for name, value in rows:
        table.add_row(name, value)
    return table


def _figures(report: Json) -> list[tuple[str, str]]:
    rows: list[tuple[str, str]] = []
    frames = report["frames"]
    for name, target in report["targets"].items():
        plane = target["iteration"]
        distance = target["distance"]["result_to_target"]["mean"]
        rows += [
            (f"{name}: iterations", f"{plane['solves']} solves"),
            (f"{name}: folds in the plane", str(plane["folds"])),
            (f"{name}: mean distance to target", f"{distance:.4f}"),
        ]
    folds = sum(frame["iteration"]["folds"] for frame in frames)
    last = frames[-1]["similarity"]
    likeness = f"W₁ = {last['wasserstein_1']:.4f}, r = {last['correlation']:.4f}"
    return [*rows, ("folds in all frames", str(folds)), ("histogram similarity", likeness)]


def _stop(server: subprocess.Popen[bytes]) -> None:
    if server.poll() is None:
        server.send_signal(signal.SIGTERM)
    try:
        code = server.wait(STOP_SECONDS)
    except subprocess.TimeoutExpired:
        server.kill()
        raise DemoError("the service did not stop within 30 seconds") from None
    if code != 0:
        raise DemoError(f"the service ended with code {code}")
