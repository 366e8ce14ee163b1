"""An edit that changes nothing gives back the very file that was sent."""

from __future__ import annotations

import numpy as np

from engine.io import read_mesh
from tests.acceptance.files import ply
from tests.acceptance.processes import Service
from tests.faces import HEAD_MOUTH_OPEN, HEAD_NEUTRAL, ICT_NEUTRAL, ICT_SMILE

pytest_plugins = ["tests.acceptance.fixtures"]


def unchanged(running: Service, name: str, content: bytes, target: bytes) -> bytes:
    """The ``mesh`` result of an edit with all weights 0."""
    source = running.uploaded(f"neutral.{name}", content)
    other = running.uploaded(f"target.{name}", target)
    edit = running.edited(
        json={
            "source": source,
            "targets": [{"mesh": other, "name": "target"}],
            "weights": {"target": 0.0},
        }
    )
    (result,) = [one for one in edit["results"] if one["role"] == "mesh"]
    assert result["name"] == f"edited.{name}"
    files = running.results(edit)
    carried = read_mesh(files[f"target-target.{name}"]).mesh.vertices
    assert np.abs(carried - read_mesh(content).mesh.vertices).max() > 0.5
    return files[result["name"]]


def test_an_obj_with_uvs_groups_and_quads(running: Service) -> None:
    content = HEAD_NEUTRAL.read_bytes()
    assert b"\nvt " in content and b"\ng " in content and len(content.split(b"\nf ")[1].split()) > 3
    assert unchanged(running, "obj", content, HEAD_MOUTH_OPEN.read_bytes()) == content


def test_a_binary_ply_with_colours_and_properties_of_its_own(running: Service) -> None:
    face = read_mesh(ICT_NEUTRAL).mesh
    chance = np.random.default_rng(3)
    count = len(face.vertices)
    colours = {name: ("u1", chance.integers(0, 256, count)) for name in ("red", "green", "blue")}
    roughness = {"roughness": ("f4", chance.random(count))}
    content = ply(face.vertices, face.faces, extra=colours | roughness)
    assert unchanged(running, "ply", content, ICT_SMILE.read_bytes()) == content
