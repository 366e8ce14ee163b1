"""Whether the correspondence agrees with itself: there and back, and under other triangulations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.correspondence_tasks import Task
from benchmarks.correspondence_ways import placed
from benchmarks.faces import as_file, remeshed
from engine.correspondence import correspond
from engine.registration import register
from engine.types import Mesh


def reversal(task: Task) -> tuple[float, float, float]:
    """There and back, deviation / diagonal: its median, 95 % quantile, median of sure vertices."""
    source, target = placed(task.source, task.target)
    there = correspond(source.surface, target.surface, register(source.mesh, target.mesh))
    back = correspond(target.surface, source.surface, register(target.mesh, source.mesh))
    returned = there.points.on(target.mesh.moved(back.points.on(source.mesh)))
    off = np.linalg.norm(returned - source.mesh.vertices, axis=1)
    off /= np.linalg.norm(np.ptp(source.mesh.vertices, axis=0))
    sure = there.confidence >= 0.9
    surely = float(np.median(off[sure])) if sure.any() else np.nan
    return float(np.median(off)), float(np.quantile(off, 0.95)), surely


def variants(task: Task, grain: float, noise: float) -> dict[str, Task]:
    """The same task with its target turned, renumbered, noisier, and remeshed.

    The target is the source displaced; it is remeshed anew, with the noise ``grain`` as it has.
    """
    random = np.random.default_rng(17)
    mesh = task.target.mesh
    turn = Rotation.from_rotvec([2.6, 1.2, -0.9]).as_matrix()
    order = random.permutation(len(mesh.vertices))
    faces = np.argsort(order)[mesh.faces][random.permutation(len(mesh.faces))]
    jitter = noise * random.normal(size=mesh.vertices.shape)
    changed = {
        "turned": replace(
            task, target=as_file(mesh.moved(mesh.vertices @ turn.T)), truth=task.truth @ turn.T
        ),
        "renumbered": replace(task, target=as_file(Mesh(mesh.vertices[order], faces))),
        "noise": replace(task, target=as_file(mesh.moved(mesh.vertices + jitter))),
    }
    true = task.source.mesh.moved(task.truth)
    for factor in (0.5, 1.0, 2.0):
        count = round(factor * len(mesh.vertices))
        other, turn, shift = remeshed(true, 5, grain, count=count)
        changed[f"x {factor:g}"] = replace(task, target=other, truth=task.truth @ turn.T + shift)
    return changed
