"""What the service adds to an edit's own time, and how busy it keeps two workers.

``python -m benchmarks.queueing``: edits that take 0.3 s each, over HTTP, through the queue, a
fresh child process, the blob store and back. Needs no other load on the machine.
"""

from __future__ import annotations

import statistics
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx

from tests.service.killing import Stack, known_mesh, running

SECONDS = 0.3
ONE_BY_ONE = 20
AT_ONCE = 40
WORKERS = 2


def main() -> None:
    with tempfile.TemporaryDirectory() as folder, running(Stack(Path(folder))) as stack:
        point = {"name": "nose", "at": {"vertex": 1}, "move": [0.0, 0.0, 1.0]}
        edit = {"source": known_mesh(stack), "control_points": {"points": [point]}}
        with httpx.Client(base_url=stack.url, timeout=60.0) as client:
            for _ in range(4):
                client.post("/v1/edits", json=edit, headers={"Prefer": "wait=30"})
            _overhead(client, edit)
            _busy(client, edit)


def _overhead(client: httpx.Client, edit: dict[str, object]) -> None:
    accepting: list[float] = []
    waiting: list[float] = []
    whole: list[float] = []
    for _ in range(ONE_BY_ONE):
        began = time.perf_counter()
        accepted = client.post("/v1/edits", json=edit)
        accepting.append(time.perf_counter() - began)
        done = client.get(f"/v1/edits/{accepted.json()['id']}?wait=30").json()
        whole.append(time.perf_counter() - began)
        assert done["status"] == "succeeded", done
        waiting.append(whole[-1] - done["summary"]["seconds"])
    for name, values in (
        ("POST until 202", accepting),
        ("POST until succeeded, less the edit's 300 ms", [value - SECONDS for value in whole]),
        ("the same, less the child's whole life", waiting),
    ):
        ordered = sorted(values)
        print(
            f"{name}: median {1000 * statistics.median(values):.0f} ms, "
            f"95 % {1000 * ordered[int(0.95 * len(ordered))]:.0f} ms"
        )


def _busy(client: httpx.Client, edit: dict[str, object]) -> None:
    began = time.perf_counter()
    with ThreadPoolExecutor(4) as pool:
        sent = pool.map(lambda _: client.post("/v1/edits", json=edit).json()["id"], range(AT_ONCE))
        ids = list(sent)
    for edit_id in ids:
        client.get(f"/v1/edits/{edit_id}?wait=60")
    seconds = time.perf_counter() - began
    share = AT_ONCE * SECONDS / (WORKERS * seconds)
    print(f"{AT_ONCE} edits at once: {seconds:.1f} s, {WORKERS} workers busy {100 * share:.0f} %")


if __name__ == "__main__":
    main()
