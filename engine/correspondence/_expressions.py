"""How faces are known to move: a face model's expressions, laid on any face."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files

import numpy as np

from engine.correspondence._fitting import Displacement, Fitting, Source, Target, Weights
from engine.correspondence._frame import Frame
from engine.correspondence._levels import build_level
from engine.correspondence._loops import pair_loops
from engine.correspondence._marks import NO_MARKS
from engine.correspondence._schedule import geometric_steps
from engine.nearest import NormalAwareIndex
from engine.operators import vertex_areas, vertex_normals
from engine.topology import boundary_loops
from engine.types import FloatArray, IntArray, Mesh, Registration, Surface

_LEVEL = 1000
_SAMPLES = 2000
_STEPS = geometric_steps(10, (0.1, 0.02), (0.1, 0.02), (0.2, 0.1))
_IDENTITY, _SIZE = 2.0, 10.0  # how readily the template changes its shape, and its size
_FADE = 0.03  # the fields end at this distance from the template, in square roots of its area
_LIES_ON = 0.01  # the template lies on a face where it comes this near
_LEAST_SHARE = 0.7  # of the template's area that must lie on a face
_SIZES = (0.6, 1.6)  # how much smaller or larger than a face's spread tells the template may end
_FREELY = 0.1  # a face needs no more (root mean square) of the template beyond its identities


@dataclass(frozen=True, slots=True)
class _Template:
    """``expressions`` (m, 3, k) and ``identities`` (m, 3, j) displace the neutral ``mesh``."""

    mesh: Mesh
    expressions: FloatArray
    identities: FloatArray

    @property
    def loops(self) -> tuple[IntArray, ...]:
        return boundary_loops(self.mesh.faces, len(self.mesh.vertices))


@cache
def _template() -> _Template:
    with (files("engine") / "data" / "expressions.npz").open("rb") as stream:
        stored = np.load(stream)
        mesh = Mesh(stored["vertices"].astype(np.float64), stored["faces"].astype(np.int64))
        fields = (
            np.moveaxis(stored[name].astype(np.float64), 0, 2)
            for name in ("expressions", "identities")
        )
        return _Template(mesh, *fields)


def expression_template(face: Surface) -> Mesh:
    """The face model's neutral face patch, as large as ``face``: what is to be registered to it."""
    mesh = _template().mesh
    return mesh.moved(mesh.vertices * (_spread(face.mesh) / _spread(mesh)))


def _spread(mesh: Mesh) -> float:
    """Root mean square distance of a surface from its centroid."""
    weights = vertex_areas(mesh)
    centred = mesh.vertices - np.average(mesh.vertices, axis=0, weights=weights)
    return float(np.sqrt(np.average((centred**2).sum(axis=1), weights=weights)))


@dataclass(frozen=True, slots=True)
class Expressions:
    """Displacement fields of known expressions around a face.

    ``mesh`` is the template as it lies on the face, in the face's own frame and unit; ``fields``
    (m, 3, k) displace its vertices.
    """

    mesh: Mesh
    fields: FloatArray

    @classmethod
    def none(cls, mesh: Mesh) -> Expressions:
        """No known expression: the face model does not fit."""
        return cls(mesh, np.zeros((len(mesh.vertices), 3, 0)))

    @property
    def count(self) -> int:
        """How many fields there are."""
        return self.fields.shape[2]

    def at(self, points: FloatArray, normals: FloatArray) -> FloatArray:
        """The fields (n, 3, k) at ``points`` (n, 3) of the face; they fade beyond the template."""
        unit = Frame.of(self.mesh).unit
        feet = NormalAwareIndex(self.mesh, 0.05 * unit).feet(points, normals)
        fade = np.exp(-((feet.distance / (_FADE * unit)) ** 2))
        weights = feet.barycentric * fade[:, None]
        return np.einsum("ni,nijk->njk", weights, self.fields[self.mesh.faces[feet.face]])


def lay_expressions(face: Surface, registration: Registration) -> Expressions:
    """The face model's expressions on ``face``; none where the model does not fit it.

    ``registration`` is that of :func:`expression_template` to the face. The template takes the
    shape of the face by its size, by its identities and freely.
    """
    template = _template()
    similarity = registration.source_from_target
    scaled = expression_template(face)
    placed = scaled.moved(similarity(scaled.vertices))
    frame = Frame.of(placed)
    rest = placed.moved(frame(placed.vertices))
    turn = similarity.rotation / Frame.of(template.mesh).unit
    identities = np.einsum("ij,njk->nik", turn, template.identities)
    shapes = np.concatenate((_IDENTITY * identities, _SIZE * rest.vertices[:, :, None]), axis=2)
    goal = Target(face.mesh.moved(frame(face.mesh.vertices)))
    source = Source(rest, shapes)
    done = _displacement(source, template.loops, goal, face.loops)
    laid, size = done.moved(source), 1.0 + _SIZE * float(done.coefficients[-1])
    freely = np.average((done.free**2).sum(axis=1), weights=source.areas)
    sized = _SIZES[0] < size < _SIZES[1]
    if not sized or freely > _FREELY**2 or _share(laid, goal) < _LEAST_SHARE:
        return Expressions.none(laid)
    fields = np.einsum("ij,njk->nik", size * frame.unit * turn, template.expressions)
    return Expressions(laid.moved(frame.back(laid.vertices)), fields)


def _displacement(
    source: Source, loops: Sequence[IntArray], goal: Target, goal_loops: Sequence[IntArray]
) -> Displacement:
    fitting = Fitting(
        source,
        build_level(source.mesh, loops, _LEVEL),
        goal,
        pair_loops(source.mesh, loops, goal.mesh, goal_loops),
        NO_MARKS,
        Weights(),
        np.zeros(len(source.mesh.vertices)),
        np.zeros_like(source.mesh.vertices),
        np.ones(len(source.mesh.vertices)),
        np.ones(len(source.mesh.vertices)),
        np.zeros(len(source.mesh.vertices)),
        (_SAMPLES, _SAMPLES, _SAMPLES),
    )
    return fitting.run(Displacement.none(source), _STEPS)


def _share(laid: Mesh, goal: Target) -> float:
    normals = vertex_normals(laid)
    feet = goal.index(0.1).feet(laid.vertices, normals)
    lies = (feet.distance < _LIES_ON) & (np.einsum("ni,ni->n", normals, feet.normal) > 0.7)
    areas = vertex_areas(laid)
    return float(areas[lies].sum() / areas.sum())
