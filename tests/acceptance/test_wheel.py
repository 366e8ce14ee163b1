"""What is installed from the wheel alone is the whole service."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import sysconfig
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest

from engine.io import read_mesh
from tests.acceptance.processes import Service, processes_of, service
from tests.faces import ICT_NEUTRAL, ICT_SMILE
from tests.service.core import ROOT

pytestmark = pytest.mark.timeout(600)
PACKAGES = ("engine", "service")
DOCUMENT = """{"source": "A_neutral.ply", "targets": [{"mesh": "A_smile.ply", "name": "smile"}],
               "output": {"formats": ["source", "glb"]}}"""


@pytest.fixture
def installed(tmp_path: Path) -> Path:
    """An environment with the wheel in it, and our dependencies within reach."""
    tree, dist, home = tmp_path / "tree", tmp_path / "dist", tmp_path / "installed"
    tree.mkdir()
    for name in PACKAGES:
        shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, tree)
    run(
        *(sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", dist, tree),
    )
    run(sys.executable, "-m", "venv", "--without-pip", home)
    (wheel,) = dist.glob("*.whl")
    python = home / "bin" / "python"
    run(
        sys.executable,
        "-m",
        "uv",
        "pip",
        "install",
        "--offline",
        "--no-deps",
        "--python",
        python,
        wheel,
    )
    place = run(python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))")
    packages = Path(place.strip())
    ours = {sysconfig.get_path(name) for name in ("purelib", "platlib")}
    (packages / "dependencies.pth").write_text("\n".join(sorted(ours)) + "\n")
    carry_compiled_kernels(packages)
    return home


def run(*command: str | Path, cwd: Path | None = None) -> str:
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def carry_compiled_kernels(packages: Path) -> None:
    """Spare the installed engine the minute that compiling its kernels takes, where we did it."""
    for ours in (ROOT / "engine").rglob("*.py"):
        theirs = packages / ours.relative_to(ROOT)
        shutil.copystat(ours, theirs)
    for compiled in (ROOT / "engine").rglob("__pycache__/*.nb[ci]"):
        theirs = packages / compiled.relative_to(ROOT)
        theirs.parent.mkdir(exist_ok=True)
        shutil.copy2(compiled, theirs)


def test_the_wheel_serves_from_anywhere(installed: Path, tmp_path: Path) -> None:
    away = tmp_path / "a folder, far away"
    away.mkdir()
    where = "import engine, service; print(engine.__file__, service.__file__, sep='\\n')"
    for origin in run(installed / "bin" / "python", "-c", where, cwd=away).splitlines():
        assert Path(origin).is_relative_to(installed)
    command = [installed / "bin" / "quasiface", "serve", "--data-dir", "the data"]
    with service(command, tmp_path / "log", cwd=away) as started:
        told = started.client.get("/version").json()
        assert told["version"] == version("quasiface")
        check_documentation(started)
        check_edit(started)
        assert processes_of(away)
        assert started.stop() == 0
    assert processes_of(away) == processes_of(installed) == []
    assert [one.name for one in away.iterdir()] == ["the data"]


def check_documentation(started: Service) -> None:
    assert "/v1/edits" in started.client.get("/openapi.json").json()["paths"]
    page = started.client.get("/docs")
    assert page.status_code == 200
    assets = re.findall(r"(?:src|href)=[\"']([^\"']+)", page.text)
    assert any(asset.endswith(".js") for asset in assets)
    for asset in assets:
        assert started.client.get(asset).status_code == 200, asset
        assert asset.startswith("/"), "the documentation reads from the network"


def check_edit(started: Service) -> None:
    files = [("files", (path.name, path.read_bytes())) for path in (ICT_NEUTRAL, ICT_SMILE)]
    edit = started.edited(data={"edit": DOCUMENT}, files=files)
    results = started.results(edit)
    assert {"edited.ply", "morph.glb", "report.json", "histogram.json", "bundle.zip"} <= set(
        results
    )
    after, smile, neutral = (
        read_mesh(content).mesh.vertices
        for content in (results["edited.ply"], ICT_SMILE, ICT_NEUTRAL)
    )
    assert np.abs(after - smile).mean() < 0.5 * np.abs(neutral - smile).mean()
