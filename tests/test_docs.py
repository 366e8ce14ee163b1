"""What the documentation prints is so: commands run, answers are as shown, links lead on."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest

from service.settings import Settings
from tests.service.killing import Stack, running

ROOT = Path(__file__).parent.parent
PRINTED = "http://127.0.0.1:8000"
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
BLOCK = re.compile(r"<!-- (tested|answer) -->\n```(sh|json)\n(.*?)^```", re.DOTALL | re.MULTILINE)
NEXT = "===== the next block ====="


@pytest.fixture(scope="module")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    stack = Stack(tmp_path_factory.mktemp("docs"), ("service.cli", "serve"))
    with running(stack):
        yield stack


def outputs(service: Stack, folder: Path, blocks: list[str]) -> list[str]:
    """What each block prints, one after the other in one shell, beside the examples."""
    (folder / "examples").symlink_to(ROOT / "examples")
    script = f"\necho; echo '{NEXT}'\n".join(["set -euo pipefail", *blocks])
    ended = subprocess.run(
        ["bash", "-c", script.replace(PRINTED, service.url)],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=280,
        check=False,
    )
    printed = ended.stdout.split(f"\n{NEXT}\n")[1:]
    assert ended.returncode == 0, f"block {len(printed)}: {printed[-1:]} {ended.stderr}"
    return printed


def like(shown: Any, given: Any) -> bool:
    """Whether an answer is as shown; ``"…"`` stands for anything, and fields may be left out."""
    match shown, given:
        case "…", _:
            return True
        case dict(), dict():
            return all(name in given and like(shown[name], given[name]) for name in shown)
        case [*first, "…"], list():
            return len(given) >= len(first) and all(map(like, first, given))
        case list(), list():
            return len(given) == len(shown) and all(map(like, shown, given))
        case _:
            return shown == given


def test_the_readme_request_runs_as_printed(service: Stack, tmp_path: Path) -> None:
    (command,) = re.findall(
        r"^```sh\n(curl .*?)^```", (ROOT / "README.md").read_text(), re.DOTALL | re.MULTILINE
    )
    (printed,) = outputs(service, tmp_path, [command])
    edit = json.loads(printed)
    assert edit["status"] == "succeeded"
    assert {"frame-0011.obj", "morph.glb", "histogram.json"} <= {x["name"] for x in edit["results"]}


def test_the_tour_runs_as_printed(service: Stack, tmp_path: Path) -> None:
    blocks = BLOCK.findall((ROOT / "docs/api.md").read_text())
    commands = [text for kind, _, text in blocks if kind == "tested"]
    printed = iter(outputs(service, tmp_path, [show(command) for command in commands]))
    last = ""
    for kind, _, text in blocks:
        if kind == "tested":
            last = next(printed)
        else:
            given = json.loads(last)
            assert like(json.loads(text), given), f"{text}\nis not like\n{given}"
    source = (ROOT / "examples/ict_face/A_neutral.ply").stat().st_size
    assert (tmp_path / "edited.ply").stat().st_size == source
    assert (tmp_path / "morph.glb").read_bytes()[:4] == b"glTF"
    assert json.loads((tmp_path / "report.json").read_text())["control_points"]


def show(command: str) -> str:
    """The command, printing also the answer that it keeps in the variable ``moved``."""
    return f'{command}echo "$moved"\n' if command.startswith("moved=") else command


@pytest.mark.parametrize("name", sorted(Settings.model_fields))
def test_every_setting_is_explained(name: str) -> None:
    lines = (ROOT / "docs/operations.md").read_text().splitlines()
    row = [line for line in lines if line.startswith(f"| `QUASIFACE_{name.upper()}` |")]
    assert len(row) == 1


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"^```.*?^```", "", page.read_text(), flags=re.DOTALL | re.MULTILINE)
    links = re.findall(r"\]\(([^)\s]+)\)", text)
    for link in links:
        path, _, heading = unquote(link).partition("#")
        if re.match(r"[a-z]+:", path):
            continue
        there = page.parent / path if path else page
        assert there.exists(), link
        if heading:
            assert heading in anchors(there), link


def anchors(page: Path) -> set[str]:
    titles = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
