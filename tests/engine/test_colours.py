"""Colours of both meshes in the correspondence."""

from collections.abc import Callable

import numpy as np
import pytest

from engine import MeshFile, Options, read_mesh
from engine.correspondence import correspond
from engine.operators import vertex_normals
from engine.pipeline import Stopwatch, prepare
from engine.pipeline.preparation import match, surface_colours
from engine.pipeline.values import Value
from engine.registration import register
from engine.types import Correspondence, FloatArray, IntArray, Mesh
from tests.acceptance.files import ply
from tests.engine.remeshed import coarser, face, relabelled, surface_of
from tests.faces import ICT_NEUTRAL, ICT_SMILE


def waves(points: FloatArray, seed: int) -> FloatArray:
    """A pattern (n, 3) about 0.5 with details from a sixth to a fiftieth of a face."""
    random = np.random.default_rng(seed)
    total = np.full((len(points), 3), 0.5)
    for length in (4.0, 2.5, 1.5):
        directions = random.normal(size=(3, 16, 3))
        directions *= 2 * np.pi / length / np.linalg.norm(directions, axis=2, keepdims=True)
        phases = random.uniform(0, 2 * np.pi, (3, 16, 1))
        total += 0.02 * np.cos(directions @ points.T + phases).sum(axis=1).T
    return total


@pytest.fixture(scope="module")
def pair() -> tuple[Mesh, Mesh, IntArray, IntArray]:
    """A neutral and a smiling face of other vertices, and which each has of the full face's."""
    neutral, ours = coarser(face(ICT_NEUTRAL), 2500)
    smile, theirs = coarser(face(ICT_SMILE), 4000)
    target, number = relabelled(smile)
    return neutral, target, ours, theirs[np.argsort(number)]


def found(
    pair: tuple[Mesh, Mesh, IntArray, IntArray], colours: tuple[FloatArray, FloatArray] | None
) -> tuple[Correspondence, float]:
    """The correspondence under ``colours``, and its mean error."""
    source, target, ours, _ = pair
    pose = register(source, target)
    answer = correspond(surface_of(source), surface_of(target), pose, colours=colours)
    off = answer.points.on(target) - face(ICT_SMILE).vertices[ours]
    return answer, float(np.linalg.norm(off, axis=1).mean())


def test_colours_tell_where_skin_slid(pair: tuple[Mesh, Mesh, IntArray, IntArray]) -> None:
    rest = face(ICT_NEUTRAL).vertices
    here, there = waves(rest[pair[2]], 1), waves(rest[pair[3]], 1)
    other_light = 40 + 150 * there * [1.0, 0.8, 0.7] + 3 * vertex_normals(pair[1])[:, :1]
    _, alone = found(pair, None)
    answer, led = found(pair, (here, other_light))
    assert "colours lead along the skin" in answer.mode
    assert led < 0.75 * alone


@pytest.mark.parametrize("kind", ["unrelated", "constant", "light", "height"])
def test_colours_that_say_nothing_change_nothing(
    pair: tuple[Mesh, Mesh, IntArray, IntArray], kind: str
) -> None:
    colours = {
        "unrelated": (waves(pair[0].vertices, 1), waves(pair[1].vertices, 2)),
        "constant": (np.full_like(pair[0].vertices, 0.7), waves(pair[1].vertices, 1)),
        "light": tuple(vertex_normals(m) @ np.full((3, 3), 0.5) for m in pair[:2]),
        "height": tuple(m.vertices for m in pair[:2]),
    }[kind]
    plain, _ = found(pair, None)
    answer, _ = found(pair, (colours[0], colours[1]))
    assert "colours do not agree" in answer.mode
    assert np.array_equal(answer.points.face, plain.points.face)
    assert np.array_equal(answer.points.barycentric, plain.points.barycentric)


class _Keys(Stopwatch):
    """Notes the keys of the stages that ran."""

    def __init__(self) -> None:
        super().__init__()
        self.keys: list[tuple[str, str]] = []

    def run(self, name: str, key: str, work: Callable[[], Value]) -> Value:
        self.keys.append((name, key))
        return super().run(name, key, work)


def coloured(mesh: Mesh, colours: FloatArray) -> MeshFile:
    lines = ["ply", "format ascii 1.0", f"element vertex {len(mesh.vertices)}"]
    lines += [f"property double {k}" for k in "xyz"]
    lines += [f"property uchar {k}" for k in ("red", "green", "blue", "alpha")]
    lines += [f"element face {len(mesh.faces)}", "property list uchar int vertex_indices"]
    lines += ["end_header"]
    levels = np.rint(255 * colours).astype(int)
    rows = zip(mesh.vertices.tolist(), levels.tolist(), strict=True)
    lines += [" ".join(map(str, (*position, *colour, 255))) for position, colour in rows]
    lines += [f"3 {a} {b} {c}" for a, b, c in mesh.faces.tolist()]
    return read_mesh("\n".join([*lines, ""]).encode())


def test_files_colours_reach_the_correspondence_and_its_key(
    pair: tuple[Mesh, Mesh, IntArray, IntArray],
) -> None:
    rest = face(ICT_NEUTRAL).vertices
    here, there = waves(rest[pair[2]], 1), waves(rest[pair[3]], 1)
    source, plain = coloured(pair[0], here), read_mesh(ply(pair[1].vertices, pair[1].faces))
    targets = [plain, coloured(pair[1], there), coloured(pair[1], 1 - there)]
    options = Options(expression_prior="off")
    keys, modes = list[str](), list[str]()
    faces = prepare(source, options, Stopwatch()), prepare(plain, options, Stopwatch())
    for target in targets:
        stages = _Keys()
        made = match(*faces, (source, target), options, stages)
        keys.append(stages.keys[-1][1])
        modes.append(made.correspondence.mode)
    assert len(set(keys)) == 3
    assert ["colours lead" in mode for mode in modes] == [False, True, False]
    assert "colours" not in modes[0]


def test_welded_vertices_have_their_copies_mean_colour() -> None:
    mesh = coarser(face(), 500)[0]
    seam = np.flatnonzero(mesh.vertices[:, 0] > 0)[:40]
    doubled = Mesh(np.concatenate([mesh.vertices, mesh.vertices[seam]]), mesh.faces)
    colours = np.zeros((len(doubled.vertices), 3))
    colours[len(mesh.vertices) :] = 1.0
    file = coloured(doubled, colours)
    surface = prepare(file, Options(), Stopwatch())
    both = surface_colours((file, file), (surface, surface))
    assert both is not None
    of = surface.surface.vertex_of
    assert np.allclose(both[0][of[seam]], 255 / 2)
    assert np.allclose(np.delete(both[0], of[seam], axis=0), 0)
