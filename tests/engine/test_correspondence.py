import numpy as np
import pytest

from engine.correspondence import correspond, expression_template, lay_expressions
from engine.correspondence._fitting import Target
from engine.correspondence._pyramid import Pyramid
from engine.correspondence._unfolding import turned_faces
from engine.registration import register
from engine.types import (
    Correspondence,
    FloatArray,
    IntArray,
    Mesh,
    Registration,
    Similarity,
    Surface,
    SurfacePoints,
)
from tests.engine.remeshed import coarser, face, motion, part_of, relabelled, subdivided, surface_of
from tests.engine.shapes import sheet, sphere
from tests.faces import ICT_JAW_OPEN, ICT_NEUTRAL, ICT_SMILE

ALIGNED = Registration(
    Similarity(np.eye(3), np.zeros(3)), np.zeros(1), 1.0, iterations=0, converged=True
)


@pytest.fixture(scope="module")
def neutral() -> tuple[Mesh, IntArray]:
    """A coarse neutral face and which vertices of the full one it has."""
    return coarser(face(ICT_NEUTRAL), 2200)


@pytest.fixture(scope="module")
def smile() -> Mesh:
    return relabelled(subdivided(coarser(face(ICT_SMILE), 3500)[0]))[0]


def distances(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.linalg.norm(a - b, axis=1)


def check_is_valid(found: Correspondence, source: Mesh, target: Mesh) -> None:
    assert len(found.points) == len(source.vertices)
    assert found.points.face.min() >= 0
    assert found.points.face.max() < len(target.faces)
    assert found.points.barycentric.min() > -1e-9
    assert np.allclose(found.points.barycentric.sum(axis=1), 1)
    assert found.confidence.min() >= 0
    assert found.confidence.max() <= 1
    assert found.mode


def at_vertices(mesh: Mesh, vertices: IntArray) -> SurfacePoints:
    _, first = np.unique(mesh.faces, return_index=True)
    corner = first[vertices]
    return SurfacePoints(corner // 3, np.eye(3)[corner % 3])


def test_a_face_corresponds_to_itself(neutral: tuple[Mesh, IntArray]) -> None:
    source = surface_of(neutral[0])
    mesh, number = relabelled(neutral[0])
    found = correspond(source, surface_of(mesh), ALIGNED)
    check_is_valid(found, source.mesh, mesh)
    size = np.linalg.norm(np.ptp(mesh.vertices, axis=0))
    assert distances(found.points.on(mesh), mesh.vertices[number]).max() < 2e-3 * size
    assert found.confidence.mean() > 0.95


def test_a_smile_is_followed_far_better_than_by_closest_points(
    neutral: tuple[Mesh, IntArray], smile: Mesh
) -> None:
    source, kept = neutral
    true = motion(20, np.array([3.0, 1.0, -2.0]), 10.0)
    target = smile.moved(true(smile.vertices))
    registration = register(source, target)
    error = {}
    for method in ("default", "paper"):
        found = correspond(surface_of(source), surface_of(target), registration, method=method)
        check_is_valid(found, source, target)
        places = true.inverse()(found.points.on(target))
        error[method] = distances(places, face(ICT_SMILE).vertices[kept]).mean()
    assert error["default"] < 0.5 * error["paper"]


def test_the_order_of_a_targets_vertices_and_faces_says_nothing(
    neutral: tuple[Mesh, IntArray], smile: Mesh
) -> None:
    source, size = neutral[0], np.linalg.norm(np.ptp(smile.vertices, axis=0))
    places = []
    for seed in (1, 2):
        target = relabelled(smile, seed)[0]
        found = correspond(surface_of(source), surface_of(target), register(source, target))
        places.append(found.on(target))
    assert distances(*places).max() < 1e-6 * size


def test_noise_changes_a_smile_little_and_is_not_carried(
    neutral: tuple[Mesh, IntArray], smile: Mesh
) -> None:
    source, kept = neutral
    truth = face(ICT_SMILE).vertices[kept]
    one, other = smile.faces[:, :2].T
    edge = np.median(distances(smile.vertices[one], smile.vertices[other]))
    noise = 0.08 * edge * np.random.default_rng(4).normal(size=smile.vertices.shape)
    rough = smile.moved(smile.vertices + noise)
    plain, noisy = (
        correspond(surface_of(source), surface_of(target), ALIGNED) for target in (smile, rough)
    )
    off = distances(noisy.on(rough), truth).mean()
    assert off < 1.15 * distances(plain.on(smile), truth).mean()
    assert off < distances(noisy.points.on(rough), truth).mean()
    assert "noise smoothed" in noisy.mode
    assert not turned_faces(source, noisy.points, Target(rough), noisy.heights).any()


def test_the_rim_of_an_opening_mouth_stretches_at_its_corners(
    neutral: tuple[Mesh, IntArray],
) -> None:
    source, kept = neutral
    mouth = min(surface_of(source).loops[1:], key=lambda loop: source.vertices[loop, 1].mean())
    target = relabelled(subdivided(coarser(face(ICT_JAW_OPEN), 3500)[0]))[0]
    found = correspond(surface_of(source), surface_of(target), ALIGNED).points.on(target)[mouth]
    truth = face(ICT_JAW_OPEN).vertices[kept][mouth]

    def steps(x: FloatArray) -> FloatArray:
        return distances(np.roll(x, -1, axis=0), x)

    rest = source.vertices[mouth]
    side = np.abs(rest[:, 0]) > 0.8 * np.abs(rest[:, 0]).max()
    true, ours = (
        (steps(x)[side].sum() / steps(rest)[side].sum())
        / (steps(x)[~side].sum() / steps(rest)[~side].sum())
        for x in (truth, found)
    )
    assert true > 1.4
    assert ours > 1.15
    assert distances(found, truth).mean() < 0.06 * distances(rest, truth).max()


def test_a_chin_follows_a_mouth_that_opens_very_wide() -> None:
    """By half wider than the bundled one: the lower lip must not take the chin's place."""
    low = np.array([1, 0.85, 1])
    rest, jaw = face(ICT_NEUTRAL).vertices, face(ICT_JAW_OPEN).vertices
    wide = face(ICT_NEUTRAL).moved((rest + 1.5 * (jaw - rest)) * low)
    source, kept = coarser(face(ICT_NEUTRAL).moved(rest * low), 5000)
    target = relabelled(subdivided(coarser(wide, 3500)[0]))[0]
    found = correspond(surface_of(source), surface_of(target), register(source, target))
    error = distances(found.points.on(target), wide.vertices[kept])
    true = distances(source.vertices, wide.vertices[kept])
    chin = true > 0.7 * true.max()
    assert error[chin].mean() < 0.12 * true[chin].mean()


def test_no_face_is_turned_over(neutral: tuple[Mesh, IntArray], smile: Mesh) -> None:
    source, _ = neutral
    found = correspond(surface_of(source), surface_of(smile), register(source, smile))
    assert not turned_faces(source, found.points, Target(smile)).any()
    assert "none left so" in found.mode


def bent_sheet(radius: float) -> Mesh:
    """A sheet of constant bend; flat for an infinite ``radius``."""
    flat = sheet(25, 31)
    x, y = flat.vertices[:, 0] - 15, flat.vertices[:, 1]
    if np.isinf(radius):
        return flat.moved(np.stack([x, y, np.zeros_like(x)], axis=1))
    around = x / radius
    return flat.moved(np.stack([radius * np.sin(around), y, radius * (np.cos(around) - 1)], 1))


def test_a_bent_sheet_is_unrolled_along_its_border() -> None:
    flat, bent = bent_sheet(np.inf), bent_sheet(40.0)
    shuffled, number = relabelled(bent)
    error = [
        distances(found.points.on(shuffled), shuffled.vertices[number]).mean()
        for found in (
            correspond(surface_of(flat), surface_of(shuffled), ALIGNED, method="default"),
            correspond(surface_of(flat), surface_of(shuffled), ALIGNED, method="paper"),
        )
    ]
    assert error[0] < 0.5 * error[1]


def test_what_is_kept_of_a_source_serves_that_source_alone() -> None:
    flat, bent, between = (surface_of(bent_sheet(radius)) for radius in (np.inf, 40.0, 80.0))
    fresh = correspond(flat, bent, ALIGNED)
    for source, target in ((flat, bent), (bent, flat), (between, bent), (flat, bent)):
        again = correspond(source, target, ALIGNED)
    assert np.array_equal(again.points.face, fresh.points.face)
    assert np.array_equal(again.points.barycentric, fresh.points.barycentric)
    assert Pyramid.of(flat.mesh, flat.loops) is Pyramid.of(flat.mesh, flat.loops)
    assert Pyramid.of(flat.mesh, ()) is not Pyramid.of(flat.mesh, flat.loops)
    assert Pyramid.of(bent.mesh, bent.loops) is not Pyramid.of(flat.mesh, flat.loops)


def test_landmarks_are_met(neutral: tuple[Mesh, IntArray], smile: Mesh) -> None:
    source, kept = neutral
    rng = np.random.default_rng(3)
    chosen = np.sort(rng.choice(len(source.vertices), 12, replace=False))
    goals = face(ICT_SMILE).vertices[kept[chosen]]
    nearest = np.array([distances(smile.vertices, goal[None]).argmin() for goal in goals])
    theirs = at_vertices(smile, nearest)
    registration = register(source, smile)
    free = correspond(surface_of(source), surface_of(smile), registration)
    led = correspond(
        surface_of(source),
        surface_of(smile),
        registration,
        landmarks=(at_vertices(source, chosen), theirs),
    )
    assert np.allclose(led.points.on(smile)[chosen], theirs.on(smile))
    truth = face(ICT_SMILE).vertices[kept]
    error = [distances(found.points.on(smile), truth).mean() for found in (free, led)]
    assert error[1] < error[0]


def test_what_the_target_does_not_show_is_not_believed(neutral: tuple[Mesh, IntArray]) -> None:
    mesh = neutral[0]
    x = mesh.vertices[:, 0]
    shown = x < np.quantile(x, 0.6)
    target = part_of(mesh, shown)
    found = correspond(surface_of(mesh), surface_of(target), ALIGNED)
    check_is_valid(found, mesh, target)
    width = np.ptp(x)
    assert found.confidence[x < np.quantile(x, 0.5)].mean() > 0.9
    assert found.confidence[x > np.quantile(x, 0.6) + 0.1 * width].mean() < 0.1
    assert "partial" in found.mode


def test_a_mirrored_target_is_survived(neutral: tuple[Mesh, IntArray]) -> None:
    mesh = neutral[0]
    mirrored = Mesh(mesh.vertices * [-1.0, 1.0, 1.0], mesh.faces[:, ::-1])
    found = correspond(surface_of(mesh), surface_of(mirrored), register(mesh, mirrored))
    check_is_valid(found, mesh, mirrored)


def test_an_inside_out_target_is_not_believed(neutral: tuple[Mesh, IntArray]) -> None:
    mesh = neutral[0]
    inverted = Mesh(mesh.vertices, mesh.faces[:, ::-1])
    found = correspond(surface_of(mesh), surface_of(inverted), ALIGNED)
    check_is_valid(found, mesh, inverted)
    assert found.confidence.mean() < 0.2


def test_closed_surfaces_correspond() -> None:
    mesh = sphere(3)
    stretched = mesh.moved(mesh.vertices * [1.0, 1.1, 1.0])
    target, number = relabelled(stretched)
    found = correspond(
        Surface(mesh, np.arange(258), np.arange(512), ()), surface_of(target), ALIGNED
    )
    assert distances(found.points.on(target), target.vertices[number]).mean() < 0.1


def test_the_paper_method_names_the_closest_vertex() -> None:
    mesh = sheet()
    target, number = relabelled(mesh)
    found = correspond(surface_of(mesh), surface_of(target), ALIGNED, method="paper")
    assert np.array_equal(found.points.on(target), target.vertices[number])
    assert np.array_equal(np.sort(found.points.barycentric, axis=1)[:, 2], np.ones(99))


def test_the_answer_does_not_depend_on_unit_and_place(neutral: tuple[Mesh, IntArray]) -> None:
    mesh, _ = coarser(neutral[0], 500)
    wide = mesh.moved(mesh.vertices * [1.03, 1.0, 1.0])
    found = correspond(surface_of(mesh), surface_of(wide), ALIGNED)
    apart = 1e4 * np.ptp(mesh.vertices)
    far = [m.moved(1e-3 * (m.vertices + apart)) for m in (mesh, wide)]
    again = correspond(surface_of(far[0]), surface_of(far[1]), ALIGNED)
    gap = distances(found.points.on(wide), again.points.on(wide))
    assert gap.max() < 1e-3 * np.ptp(mesh.vertices)


def test_known_expressions_bring_a_smile_nearer(neutral: tuple[Mesh, IntArray]) -> None:
    source, kept = neutral
    target = face(ICT_SMILE)
    template = expression_template(surface_of(source))
    known = lay_expressions(surface_of(source), register(source, template))
    registration = register(source, target)
    error = {}
    for name, expressions in (("alone", None), ("known", known)):
        found = correspond(
            surface_of(source), surface_of(target), registration, expressions=expressions
        )
        check_is_valid(found, source, target)
        error[name] = distances(found.points.on(target), target.vertices[kept]).mean()
    assert "known expressions" in found.mode
    assert error["known"] < 0.8 * error["alone"]


def test_a_face_model_does_not_fit_a_ball() -> None:
    ball = sphere(3)
    known = lay_expressions(surface_of(ball), register(ball, expression_template(surface_of(ball))))
    assert known.count == 0
    again = correspond(surface_of(ball), surface_of(ball), ALIGNED, expressions=known)
    assert "not used" in again.mode


def test_known_expressions_follow_the_face(neutral: tuple[Mesh, IntArray]) -> None:
    mesh = neutral[0]
    far = motion(100, np.array([300.0, 0.0, 50.0]), 0.01)
    laid = [
        lay_expressions(surface_of(m), register(m, expression_template(surface_of(m))))
        for m in (mesh, mesh.moved(far(mesh.vertices)))
    ]
    expected = 0.01 * np.einsum("ij,njk->nik", far.rotation, laid[0].fields)
    gap = np.linalg.norm(laid[1].fields - expected, axis=1)
    assert gap.mean() < 0.02 * np.linalg.norm(expected, axis=1).mean()
