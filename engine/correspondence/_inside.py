"""Where the insides of cavities go once the outside has been fitted."""

from __future__ import annotations

import numpy as np

from engine.correspondence._energy import DeformableSurface
from engine.correspondence._fitting import Displacement, Fitting, Source, Step, Target, Weights
from engine.correspondence._levels import build_level
from engine.correspondence._marks import Marks
from engine.correspondence._spreading import Spreading
from engine.correspondence._static import AROUND, Nearby, calm_share, static_share
from engine.linalg import FixedSolver
from engine.types import BoolArray, FloatArray, IntArray, Mesh

_RINGS = 2  # of the outside around an inside that are fitted with it
_RESTS, _CALM_RESTS = 0.5, 0.3  # static shares from which the inside is taken to be at rest
_BENDING = 0.02  # length below which the extension bends rather than stretches
_STEPS = tuple(
    Step(float(smooth), float(reach), 0.04)
    for smooth, reach in zip(np.geomspace(0.03, 0.01, 4), np.geomspace(0.05, 0.015, 4), strict=True)
)
_HELD = 20.0  # pull of the outside to its place
_RESTING, _CALM = 0.3, 5.0  # pulls of the inside to its rest, where most of a cavity rests
_WEIGHTS = Weights(point=0.05, back=0.5, static=1.0)
_LEVEL, _SAMPLES = 4000, 4000


def fit_inside(
    rest: Mesh, outside: IntArray, positions: FloatArray, goal: Target, marks: Marks
) -> FloatArray:
    """Positions (n, 3) of all of ``rest``, whose vertices ``outside`` have ``positions``.

    The outside's displacement is extended into the cavities, where parts that lie on the target
    already stay; a few steps bring the inside onto ``goal`` while the outside is held. A cavity of
    which most already lies there is held firmly too, up to its rim.
    """
    if len(outside) == len(rest.vertices):
        return positions
    inside = np.ones(len(rest.vertices), dtype=np.bool_)
    inside[outside] = False
    x = rest.vertices.copy()
    x[outside] = positions
    nearby = Nearby.of(rest, goal)
    static = static_share(nearby, Spreading.over(rest, AROUND))
    calm = calm_share(rest, inside, nearby)
    vertex, part = _surroundings(rest, inside)
    inner = inside[vertex]
    known = ~inner | ((static > _RESTS) | (calm > _CALM_RESTS))[vertex]
    given = x[vertex] - part.vertices
    start = _extended(part, np.flatnonzero(known), given[known])
    fitting = Fitting(
        Source(part, np.zeros((len(vertex), 3, 0))),
        build_level(part, (), _LEVEL),
        goal,
        (),
        marks.touching(part),
        _WEIGHTS,
        np.where(inner, np.maximum(_RESTING * static, _CALM * calm)[vertex], _HELD),
        given,
        np.ones(len(vertex)),
        np.ones(len(vertex)),
        np.zeros(len(vertex)),
        (_SAMPLES, _SAMPLES, _SAMPLES),
    )
    moved = fitting.run(Displacement(start, np.zeros(0)), _STEPS).free
    x[vertex[inner]] = (part.vertices + moved)[inner]
    return x


def _surroundings(mesh: Mesh, inside: BoolArray) -> tuple[IntArray, Mesh]:
    """The vertices ``inside``, those within a few rings of them, and the mesh of these."""
    for _ in range(_RINGS):
        touched = inside[mesh.faces].any(axis=1)
        inside = np.zeros_like(inside)
        inside[mesh.faces[touched]] = True
    faces = mesh.faces[inside[mesh.faces].all(axis=1)]
    vertex, flat = np.unique(faces, return_inverse=True)
    return vertex, Mesh(mesh.vertices[vertex], flat.reshape(-1, 3))


def _extended(part: Mesh, known: IntArray, displacement: FloatArray) -> FloatArray:
    """Displacements (n, 3) of all vertices where those ``known`` have ``displacement``.

    Its membrane energy plus ℓ² times its bending energy is least (bending alone swings out in
    deep cavities).
    """
    surface = DeformableSurface(part)
    energy = surface.laplacian + _BENDING**2 * surface.bilaplacian
    return FixedSolver(energy, known).solve(displacement)
