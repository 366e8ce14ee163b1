"""Choices of the method over HTTP."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from engine.io import read_mesh
from tests.acceptance.files import ply, small
from tests.acceptance.processes import Service
from tests.faces import ICT_SMILE

pytest_plugins = ["tests.acceptance.fixtures"]

CHOICES = [
    {"holes": "kept"},
    {"holes": "kept", "parameterization": "paper", "restoration": "paper"},
    {"outer_boundary": "sliding", "holes": "kept"},
    {"outer_boundary": "sliding"},
    {"iteration": "minimal"},
    {"iteration": "minimal", "outer_boundary": "sliding"},
    {"iteration": "teichmueller"},
    {"iteration": "paper_teichmueller"},
]


@pytest.mark.parametrize("options", CHOICES, ids=lambda options: "-".join(options.values()))
def test_every_choice_leads_to_an_edit(running: Service, options: dict[str, Any]) -> None:
    face, smile = small(), small(ICT_SMILE)
    edit = running.edited(
        json={
            "source": running.uploaded("small.ply", ply(face.vertices, face.faces)),
            "targets": [
                {
                    "mesh": running.uploaded("smile.ply", ply(smile.vertices, smile.faces)),
                    "name": "smile",
                }
            ],
            "control_points": {"auto": 20},
            "options": options,
        }
    )
    results = running.results(edit)
    assert results["plane.png"].startswith(b"\x89PNG")
    report = json.loads(results["report.json"])
    assert report["options"] == {**report["options"], **options}
    for shown in json.loads(results["histogram.json"])["maps"]:
        assert sum(shown["counts"]) + shown["undefined"] == len(face.faces)
        assert shown["folds"] == 0 or options.get("iteration") == "paper_teichmueller"
    moved = read_mesh(results["edited.ply"]).mesh.vertices - face.vertices
    assert np.linalg.norm(moved, axis=1).max() > 0.1
