"""Non-rigid registration of a displaced surface to a target: the iteration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from engine.correspondence._colours import Colours
from engine.correspondence._energy import Pulls
from engine.correspondence._levels import Level, interpolated
from engine.correspondence._loops import LoopPair
from engine.correspondence._marks import Marks
from engine.correspondence._smoothing import roughness
from engine.nearest import NormalAwareIndex, Stars, vertex_stars
from engine.operators import vertex_areas, vertex_normals
from engine.types import FloatArray, IntArray, Mesh

_DAMPING = 1e-6  # of each vertex towards its last displacement, over ℓ⁴
_TILTED = 0.065  # roughness at which a target's normals are off as much as the source's may be
_RIDGE, _LEAST_RIDGE = 1.0, 3e-8  # of the fields' coefficients: over ℓ⁴, and at least


@dataclass(frozen=True, slots=True)
class Step:
    """One step's lengths, in square roots of the source's area.

    ``smooth`` ℓ: detail below this length is smoothness' business; ``reach`` σ of the Welsch
    kernel on closest-point distances; ``normal_weight`` of the closest-point search. ``beyond`` is
    the share by which the free displacement is first taken beyond where it is.
    """

    smooth: float
    reach: float
    normal_weight: float
    beyond: float = 0.0


@dataclass(frozen=True, slots=True)
class Weights:
    """Weights of the energy's terms relative to the source's point-to-plane term."""

    point: float = 0.005  # point-to-point part of a source vertex's pull
    back: float = 8.0  # planes of target vertices on the source
    loop: float = 2.0
    rim: float = 1.0  # what is left of that where a pair is not sharp
    lid: float = 3.0  # how much more the edge of a lid counts, sharp on both surfaces
    doubt: float = 0.0  # the power with which the trust in such a pair's vertices counts
    slit_slide: float = 0.5  # tangential part of a loop's pull where its parameters are fixed
    gradual: float = 0.0  # share of smoothness asked of what a step adds, not of all
    stiff: float = 1.0  # how many times as much bending costs where there is little
    mixed: bool = False  # whether planes of a rough target are mixed with the source's
    outer_slide: float = 0.02
    landmark: float = 0.002  # area that a landmark stands for
    stretching: float = 0.05
    static: float = 0.0
    agree: float = 0.5  # least cosine of matching normals


class Target:
    """The target in the source's frame, its indices by normal weight, and samples of it.

    ``rough``: the roughness of the surface that was given, if that is not ``mesh`` itself.
    """

    def __init__(self, mesh: Mesh, rough: float | None = None) -> None:
        self.mesh = mesh
        self._rough = rough
        self.normals = vertex_normals(mesh)
        self._areas = vertex_areas(mesh)
        self._first = self._searched(0.1, None)
        self._indices = {0.1: self._first}
        self._order = np.random.default_rng(0).permutation(np.flatnonzero(self._areas > 0))

    def index(self, normal_weight: float) -> NormalAwareIndex:
        """The index for a normal weight, rounded to hundredths."""
        key = round(normal_weight, 2)
        if key not in self._indices:
            self._indices[key] = self._searched(key, self._first.stars)
        return self._indices[key]

    def _searched(self, normal_weight: float, stars: Stars | None) -> NormalAwareIndex:
        return NormalAwareIndex(self.mesh, normal_weight, stars)

    @cached_property
    def doubt(self) -> float:
        """The share of the normals' variance, told by their roughness, in it and the source's."""
        rough = roughness(self.mesh) if self._rough is None else self._rough
        return float((rough / np.hypot(rough, _TILTED)) ** 2)

    def planes(self, chosen: IntArray, beside: FloatArray) -> FloatArray:
        """Normals (k, 3) of the planes of ``chosen`` vertices, ``beside`` them those of a source.

        Planes that noise tilts hold skin back where it should slide along itself: either normal
        counts by how little it is likely to be off.
        """
        mixed = (1 - self.doubt) * self.normals[chosen] + self.doubt * beside
        return mixed / np.maximum(np.linalg.norm(mixed, axis=1), 1e-300)[:, None]

    def samples(self, count: int, turn: int) -> tuple[IntArray, FloatArray]:
        """At most ``count`` vertices, others at each ``turn``, and the area each stands for."""
        return drawn(self._order, self._areas, count, turn)


def drawn(order: IntArray, areas: FloatArray, count: int, turn: int) -> tuple[IntArray, FloatArray]:
    """At most ``count`` of the vertices in ``order``, others at each ``turn``, and their areas."""
    chosen = np.sort(np.roll(order, -turn * count)[:count])  # neighbours are looked up together
    return chosen, areas[chosen] * (areas[order].sum() / areas[chosen].sum())


def welsch(distance: FloatArray, width: float) -> FloatArray:
    """exp(-d² / 2σ²): how much a foot at this distance counts."""
    return np.exp(-(distance**2) / (2 * width**2))


@dataclass(frozen=True)
class Source:
    """The surface to displace at the resolution at which it is compared with the target.

    ``fields`` (n, 3, k) are displacement fields that cost nothing but their coefficients: how
    such a surface may well move; k = 0 if nothing is known.
    """

    mesh: Mesh
    fields: FloatArray

    @cached_property
    def areas(self) -> FloatArray:
        """Vertex areas (n,)."""
        return vertex_areas(self.mesh)

    @cached_property
    def stars(self) -> Stars:
        """The faces around each vertex."""
        return vertex_stars(self.mesh.faces, len(self.mesh.vertices))

    @cached_property
    def order(self) -> IntArray:
        """The vertices with faces, shuffled: in turn they are compared with the target."""
        return np.random.default_rng(0).permutation(np.flatnonzero(self.areas > 0))


@dataclass(frozen=True, slots=True)
class Displacement:
    """``free`` (n, 3) displacements of a source, and ``coefficients`` (k,) of its fields."""

    free: FloatArray
    coefficients: FloatArray

    @classmethod
    def none(cls, source: Source) -> Displacement:
        """The source at rest."""
        return cls(np.zeros_like(source.mesh.vertices), np.zeros(source.fields.shape[2]))

    def beyond(self, share: FloatArray) -> Displacement:
        """This displacement with its free part gone on by a ``share`` (n,) of itself."""
        return replace(self, free=(1 + share[:, None]) * self.free)

    def ahead(self, before: Displacement, momentum: float, free: FloatArray) -> Displacement:
        """This displacement, gone on from the one ``before`` by ``momentum`` of the way.

        Of that the free part at each vertex goes ``free`` (n,).
        """
        return Displacement(
            self.free + momentum * free[:, None] * (self.free - before.free),
            self.coefficients + momentum * (self.coefficients - before.coefficients),
        )

    def moved(self, source: Source) -> Mesh:
        """The displaced source."""
        x = source.mesh.vertices + self.free
        if len(self.coefficients):
            x = x + source.fields @ self.coefficients
        return source.mesh.moved(x)


@dataclass(frozen=True)
class Fitting:
    """Everything that stays the same while ``source`` is displaced onto ``target``.

    The free displacement lives on ``level``; what pulls at it is measured on the source itself,
    ``samples`` vertices of it and of the target at a time, the third number of the target in the
    last step: it alone makes the answer, and noise averages out. ``static`` (n,) tells how
    surely and firmly a vertex's displacement is ``home`` (n, 3), ``shown`` (n,) in [0, 1] how much
    the surfaces' pulls on it count, ``own`` (n,) in [0, 1] how surely what pulls is no other skin,
    ``inert`` (n,) how much its free displacement is pulled towards none. ``colours`` are
    those of both, if they are to be used.
    """

    source: Source
    level: Level
    target: Target
    loops: tuple[LoopPair, ...]
    marks: Marks
    weights: Weights
    static: FloatArray
    home: FloatArray
    shown: FloatArray
    own: FloatArray
    inert: FloatArray
    samples: tuple[int, int, int]
    colours: Colours | None = None

    def run(
        self, start: Displacement, steps: Sequence[Step], momentum: float = 0.0
    ) -> Displacement:
        """The displacement after all ``steps`` from ``start``.

        Each step minimises data terms at the current closest points plus ℓ⁴ times the bending
        (biharmonic) energy of the free displacement and a little of its membrane energy. Planes
        that do not quite agree hold skin back where it slides along itself, and so does smoothness:
        steps may begin ``beyond`` where the last one ended, which data take back where they tell,
        a share of smoothness may be ``gradual`` (iterated Tikhonov regularisation), and
        ``momentum`` is how much of each step's motion the next one begins with (Polyak, 1964). All
        three only as far as what pulls at a vertex is its ``own``: motion that goes on by itself
        never ends where no data take it back.
        """
        before = current = start
        for turn, step in enumerate(steps):
            if step.beyond > 0:
                before = current = current.beyond(step.beyond * self.own)
            ahead = current.ahead(before, momentum, self.own)
            count = self.samples[2 if turn == len(steps) - 1 else 1]
            samples = self.target.samples(count, turn)
            before, current = current, self._step(ahead, step, turn, samples)
        return current

    def _step(
        self, current: Displacement, step: Step, turn: int, samples: tuple[IntArray, FloatArray]
    ) -> Displacement:
        moved = current.moved(self.source)
        parts = [self._to_target(moved, step, turn), self._marks()]
        parts += [self._on_loop(pair, moved, step) for pair in self.loops]
        if self.weights.back > 0:
            parts.append(self._from_target(moved, step, samples))
        if self.weights.static > 0:
            parts.append(self._home())
        pulls = Pulls.joined(parts)
        surface, bending = self.level.surface, step.smooth**4
        stretching = self.weights.stretching * step.smooth**2
        before = current.free[self.level.kept]
        stiff = surface.stiffness(before, self.weights.stiff) if self.weights.stiff > 1 else None
        kept = self.weights.gradual * self.own[self.level.kept]
        system = surface.smoothness(bending, stretching, kept[:, None] * before, stiff)
        surface.add_rest(system, before, np.full(surface.n, _DAMPING * bending))
        surface.add_rest(system, np.zeros_like(before), self.inert[self.level.kept] * surface.areas)
        surface.add_pulls(system, pulls)
        if pulls.fields.shape[2] == 0:
            free, coefficients = surface.solve(system), current.coefficients
        else:
            ridge = max(_RIDGE * bending, _LEAST_RIDGE)
            free, coefficients = surface.solve_with_fields(system, pulls, ridge)
        return Displacement(self.level.prolonged(free), coefficients)

    def _pulls(self, vertices: IntArray, blocks: FloatArray, goals: FloatArray) -> Pulls:
        """Pulls of source ``vertices`` to displacements ``goals``."""
        level = self.level
        return Pulls(
            level.face[vertices],
            level.barycentric[vertices],
            blocks,
            goals,
            self.source.fields[vertices],
        )

    def _to_target(self, moved: Mesh, step: Step, turn: int) -> Pulls:
        chosen, areas = drawn(self.source.order, self.source.areas, self.samples[0], turn)
        normals = vertex_normals(moved)[chosen]
        feet = self.target.index(step.normal_weight).feet(moved.vertices[chosen], normals)
        agree = np.einsum("ni,ni->n", normals, feet.normal) > self.weights.agree
        w = areas * welsch(feet.distance, step.reach) * (agree & ~feet.on_border)
        w *= self.shown[chosen]
        planes = feet.normal[:, :, None] * feet.normal[:, None, :]
        planes += self.weights.point * np.eye(3)
        goals = feet.position - self.source.mesh.vertices[chosen]
        if self.colours is not None:
            stiffness, along = self.colours.along(step.smooth, chosen, feet)
            planes, goals = planes + stiffness, goals + along
        return self._pulls(chosen, w[:, None, None] * planes, goals)

    def _on_loop(self, pair: LoopPair, moved: Mesh, step: Step) -> Pulls:
        positions = moved.vertices[pair.vertices]
        goals, tangents = pair.goals(positions)
        gaps = np.linalg.norm(np.roll(positions, -1, axis=0) - positions, axis=1)
        w = self.weights.loop * step.smooth * (gaps + np.roll(gaps, 1)) / 2
        w *= 1.0 if pair.sharp else self.weights.rim * pair.trust**self.weights.doubt
        w *= self.weights.lid if pair.lid else 1.0
        free = self.weights.outer_slide if pair.slides else self.weights.slit_slide
        across = np.eye(3) - (1 - free) * tangents[:, :, None] * tangents[:, None, :]
        rest = self.source.mesh.vertices[pair.vertices]
        return self._pulls(pair.vertices, w[:, None, None] * across, goals - rest)

    def _from_target(self, moved: Mesh, step: Step, samples: tuple[IntArray, FloatArray]) -> Pulls:
        """Target vertices pull at the source vertex next to their foot, as if it were there."""
        chosen, areas = samples
        points, normals = self.target.mesh.vertices[chosen], self.target.normals[chosen]
        index = NormalAwareIndex(moved, step.normal_weight, self.source.stars)
        feet = index.feet(points, normals)
        agree = np.einsum("ti,ti->t", normals, feet.normal) > self.weights.agree
        w = self.weights.back * areas * welsch(feet.distance, step.reach)
        corner = feet.barycentric.argmax(axis=1)
        vertices = self.source.mesh.faces[feet.face, corner]
        w *= (agree & ~feet.on_border) * self.shown[vertices]
        planes = self.target.planes(chosen, feet.normal) if self.weights.mixed else normals
        blocks = w[:, None, None] * planes[:, :, None] * planes[:, None, :]
        so_far = moved.vertices[vertices] - self.source.mesh.vertices[vertices]
        return self._pulls(vertices, blocks, points - feet.position + so_far)

    def _home(self) -> Pulls:
        held = np.flatnonzero(self.static > 0)
        w = self.weights.static * self.static[held] * self.source.areas[held]
        return self._pulls(held, w[:, None, None] * np.eye(3), self.home[held])

    @cached_property
    def _mark_places(self) -> tuple[IntArray, FloatArray, FloatArray]:
        """Where the marks lie on the level, and the fields there."""
        points, normals = self.marks.points, self.marks.normals
        face, barycentric = self.level.place(points, normals)
        feet = NormalAwareIndex(self.source.mesh, 0.0, self.source.stars).feet(points, normals)
        fields = interpolated(self.source.mesh, feet.face, feet.barycentric, self.source.fields)
        return face, barycentric, fields

    def _marks(self) -> Pulls:
        face, barycentric, fields = self._mark_places
        blocks = np.tile(self.weights.landmark * np.eye(3), (len(face), 1, 1))
        return Pulls(face, barycentric, blocks, self.marks.goals - self.marks.points, fields)
