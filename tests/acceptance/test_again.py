"""Another edit of the same meshes and points solves only what its weights change."""

from __future__ import annotations

import json
from typing import Any

import numpy as np

from engine import ControlPoint, EditPlan, VertexAddress, edit, read_mesh
from tests.acceptance.processes import Service
from tests.faces import ICT_NEUTRAL, ICT_SMILE

pytest_plugins = ["tests.acceptance.fixtures"]

NOSE_TIP = 1514
KEPT = (
    *("topology", "parameterization", "registration"),
    *("correspondence", "iteration", "restoration"),
)


def test_other_weights_reuse_the_planes_and_give_what_they_would_alone(running: Service) -> None:
    source = running.uploaded("again.ply", ICT_NEUTRAL.read_bytes())
    target = running.uploaded("again_smile.ply", ICT_SMILE.read_bytes())

    def asked(weight: float, **output: object) -> dict[str, Any]:
        points = [{"name": "nose", "at": {"vertex": NOSE_TIP}, "weights": {"smile": 0.1}}]
        return running.edited(
            json={
                "source": source,
                "targets": [{"mesh": target, "name": "smile"}],
                "control_points": {"points": points, "auto": 40},
                "weights": {"smile": weight},
                "output": output,
            }
        )

    first, second = asked(1.0), asked(0.4)
    cached = {stage["name"]: stage["cached"] for stage in second["stages"]}
    assert [cached[name] for name in KEPT] == [True] * len(KEPT)
    assert not any(stage["cached"] for stage in first["stages"] if stage["name"] == "iteration")
    point = ControlPoint("nose", VertexAddress(NOSE_TIP), weights={"smile": 0.1})
    plan = EditPlan(points=(point,), auto=40, weights={"smile": 0.4})
    alone = edit(read_mesh(ICT_NEUTRAL), {"smile": read_mesh(ICT_SMILE)}, plan)
    there = read_mesh(running.results(second)["edited.ply"]).mesh.vertices
    np.testing.assert_allclose(there, alone.frames[0].vertices, rtol=0, atol=1e-5)

    whole, bare = running.results(second), running.results(asked(0.4, figures=False))
    meshes = {"edited.ply", "target-smile.ply"}
    assert bare.keys() == meshes | {"report.json"}
    assert whole.keys() > bare.keys()
    assert {name: bare[name] for name in meshes} == {name: whole[name] for name in meshes}
    report = json.loads(bare["report.json"])
    assert report["frames"][0]["turned_faces"] == 0
    assert report["targets"]["smile"]["registration"]["converged"]
    assert report["control_points"][0]["plane_after"] is None
