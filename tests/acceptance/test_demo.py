"""``quasiface demo``: everything, once, from one command."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from pygltflib import GLTF2

from engine.io import read_mesh
from tests.acceptance.processes import processes_of
from tests.faces import DATA
from tests.service.core import ROOT

pytestmark = pytest.mark.timeout(600)
FACES = DATA / "ict_face"
FRAMES = 3


def test_the_demo_leaves_results_and_no_process(tmp_path: Path) -> None:
    faces, out = tmp_path / "faces", tmp_path / "some results"
    shutil.copytree(FACES, faces)
    document = json.loads((faces / "edit.json").read_text()) | {"frames": FRAMES}
    (faces / "short.json").write_text(json.dumps(document))
    command = [sys.executable, "-m", "service.cli", "demo", faces / "short.json", "--out", out]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr + done.stdout
    assert processes_of(tmp_path) == []
    for row in ("smile: mean distance to target", "folds in all frames", "frames"):
        assert row in done.stdout
    neutral = read_mesh(FACES / "A_neutral.ply").mesh
    for index in range(FRAMES):
        frame = read_mesh(out / f"frame-{index:04d}.obj").mesh
        assert frame.faces.tolist() == neutral.faces.tolist()
    names = {path.name for path in out.iterdir() if not path.name.startswith(".")}
    assert names >= {
        *("report.json", "histogram.json", "histogram.png", "plane.png", "bundle.zip"),
        *("morph.glb", "target-smile.obj", "target-jaw_open.obj"),
    }
    check_morph(out / "morph.glb", len(neutral.vertices))


def check_morph(path: Path, vertices: int) -> None:
    morph = GLTF2().load(path)
    assert morph is not None
    (mesh,) = morph.meshes
    assert mesh.extras["targetNames"][:2] == ["smile", "jaw_open"]
    (primitive,) = mesh.primitives
    for target in primitive.targets:
        assert morph.accessors[target["POSITION"]].count == vertices
    (animation,) = morph.animations
    (channel,) = animation.channels
    assert channel.target.path == "weights"
    assert morph.accessors[animation.samplers[channel.sampler].input].count >= FRAMES
