from dataclasses import replace

import numpy as np
import pytest

from engine.correspondence._charts import Chart
from engine.correspondence._confidence import confidence, existence
from engine.correspondence._fitting import Target
from engine.correspondence._projection import Freedom, project
from engine.correspondence._unfolding import turned_faces, unfolded
from engine.operators import adjacency, vertex_normals
from engine.topology import boundary_loops
from engine.types import BoolArray, FloatArray, IntArray, Mesh, SurfacePoints
from tests.engine.remeshed import coarser, face, relabelled, subdivided
from tests.engine.shapes import grid_faces, sheet, torus
from tests.faces import ICT_NEUTRAL


@pytest.fixture(scope="module")
def source() -> Mesh:
    return coarser(face(ICT_NEUTRAL), 2200)[0]


@pytest.fixture(scope="module")
def target(source: Mesh) -> Target:
    return Target(relabelled(subdivided(source))[0])


def images(source: Mesh, target: Target, places: FloatArray) -> SurfacePoints:
    feet = target.index(0.1).feet(places, vertex_normals(source))
    return SurfacePoints(feet.face, feet.barycentric)


def everywhere(source: Mesh) -> Freedom:
    return Freedom(np.zeros(len(source.vertices), dtype=np.int64), ())


def there(source: Mesh) -> tuple[BoolArray, BoolArray]:
    """Every vertex exists, surely."""
    everything = np.ones(len(source.vertices), dtype=np.bool_)
    return everything, everything


def newly_turned(source: Mesh, points: SurfacePoints, target: Target) -> BoolArray:
    """(m,) faces turned over that are not so where they belong: two lie so in a crease."""
    true = images(source, target, source.vertices)
    return turned_faces(source, points, target) & ~turned_faces(source, true, target)


def past_a_neighbour(source: Mesh, moved: IntArray) -> FloatArray:
    """The vertices' positions, those of ``moved`` ones beyond one of their neighbours."""
    first = np.array([source.faces[(source.faces == v).any(axis=1)][0] for v in moved])
    ahead = np.where(first[:, 0] == moved, first[:, 1], first[:, 0])
    places = source.vertices.copy()
    places[moved] += 1.5 * (source.vertices[ahead] - source.vertices[moved])
    return places


def test_every_face_that_is_turned_over_is_laid_out_again(source: Mesh, target: Target) -> None:
    moved = np.random.default_rng(5).choice(len(source.vertices), 40, replace=False)
    true = images(source, target, source.vertices)
    points = images(source, target, past_a_neighbour(source, moved))
    laid = unfolded(source, points, target, everywhere(source), *there(source))
    assert laid.found > 40
    assert not laid.left.any()
    assert not newly_turned(source, laid.points, target).any()
    gap = laid.points.on(target.mesh) - true.on(target.mesh)
    assert np.linalg.norm(gap, axis=1).max() < 0.05 * np.ptp(source.vertices)


def test_a_face_upside_down_in_a_crease_stays_so_only_among_faces_that_are_the_same(
    source: Mesh, target: Target
) -> None:
    same = images(source, target, source.vertices)
    crease = np.flatnonzero(turned_faces(source, same, target))
    assert len(crease) > 0
    kept = unfolded(source, same, target, everywhere(source), *there(source))
    assert kept.found == 0
    assert turned_faces(source, kept.points, target)[crease].all()
    corners = np.unique(source.faces[crease])
    near = np.isin(source.faces, corners).any(axis=1)
    around = np.setdiff1d(source.faces[near], corners)
    places = source.vertices.copy()
    places[around] += 0.3 * (places.mean(axis=0) - places[around]) * [0.1, 0.1, 0.0]
    changed = unfolded(
        source, images(source, target, places), target, everywhere(source), *there(source)
    )
    assert changed.found >= len(crease)
    assert not turned_faces(source, changed.points, target).any()


def test_places_stay_near_where_the_target_is_much_finer() -> None:
    """Between the images of neighbours lie so many of its faces that they fall apart."""
    source = coarser(face(ICT_NEUTRAL), 600)[0]
    fine = subdivided(subdivided(subdivided(source)))
    target = Target(relabelled(fine)[0])
    moved = np.random.default_rng(5).choice(len(source.vertices), 12, replace=False)
    points = images(source, target, past_a_neighbour(source, moved))
    laid = unfolded(source, points, target, everywhere(source), *there(source))
    assert not laid.left.any()
    gap = laid.points.on(target.mesh) - source.vertices
    assert np.linalg.norm(gap, axis=1).max() < 0.1 * np.ptp(source.vertices)


def test_faces_that_shrank_to_points_are_opened(source: Mesh, target: Target) -> None:
    chosen = np.arange(0, len(source.faces), 150)
    places = source.vertices.copy()
    for corners in source.faces[chosen]:
        places[corners] = places[corners].mean(axis=0)
    points = images(source, target, places)
    assert turned_faces(source, points, target)[chosen].mean() > 0.5
    laid = unfolded(source, points, target, everywhere(source), *there(source))
    assert not laid.left.any()
    assert not newly_turned(source, laid.points, target).any()


def test_a_landmark_stays_where_it_was_sent(source: Mesh, target: Target) -> None:
    moved = np.random.default_rng(6).choice(len(source.vertices), 40, replace=False)
    points = images(source, target, past_a_neighbour(source, moved))
    free = everywhere(source)
    free.kind[moved[:5]] = -1
    laid = unfolded(source, points, target, free, *there(source))
    before, after = points.on(target.mesh), laid.points.on(target.mesh)
    assert np.array_equal(before[moved[:5]], after[moved[:5]])
    assert turned_faces(source, laid.points, target).sum() < 0.2 * laid.found


def test_faces_across_a_sharp_fold_lie_upright_on_it() -> None:
    """Two sheets nearly back to back: what is in order along them may not be so in space."""
    rows, columns, half = 21, 41, 20
    y, x = np.meshgrid(np.arange(rows), np.arange(columns) - half, indexing="ij")
    folded = np.stack([-np.abs(x), y, 0.05 * x], axis=-1).reshape(-1, 3)
    mesh = Mesh(folded, grid_faces(rows, columns))
    target = Target(mesh)
    slid = x + np.where(np.abs(x) <= 3, 0.45, 0.0)
    points = on_grid(slid.ravel() + half, y.ravel(), rows, columns)
    assert turned_faces(mesh, points, target).any()
    laid = unfolded(mesh, points, target, everywhere(mesh), *there(mesh))
    assert not laid.left.any()
    assert not turned_faces(mesh, laid.points, target).any()


def on_grid(x: FloatArray, y: FloatArray, rows: int, columns: int) -> SurfacePoints:
    """The points (k,) of the faces of a grid, x along its rows."""
    column = np.minimum(np.floor(x), columns - 2).astype(np.int64)
    row = np.minimum(np.floor(y), rows - 2).astype(np.int64)
    right, up = x - column, y - row
    lower = right >= up
    weights = np.where(
        lower[:, None],
        np.stack([1 - right, right - up, up], axis=1),
        np.stack([1 - up, right, up - right], axis=1),
    )
    return SurfacePoints(2 * (row * (columns - 1) + column) + ~lower, weights)


def test_rims_that_run_backwards_are_set_right_along_themselves(
    source: Mesh, target: Target
) -> None:
    true = images(source, target, source.vertices)
    goals = boundary_loops(target.mesh.faces, len(target.mesh.vertices))
    free = Freedom(np.zeros(len(source.vertices), dtype=np.int64), tuple(goals))
    face, barycentric = true.face.copy(), true.barycentric.copy()
    for loop in boundary_loops(source.faces, len(source.vertices)):
        corner = target.mesh.faces[true.face[loop[0]], true.barycentric[loop[0]].argmax()]
        free.kind[loop] = 1 + next(k for k, goal in enumerate(goals) if corner in goal)
        early, late = loop[:-2:9], loop[2::9]
        face[early], barycentric[early] = true.face[late], true.barycentric[late]
    laid = unfolded(source, SurfacePoints(face, barycentric), target, free, *there(source))
    assert laid.found > 10
    assert not laid.left.any()
    on_rim = np.isin(target.mesh.faces[laid.points.face], np.concatenate(goals))
    off_it = np.where(on_rim, 0.0, laid.points.barycentric)[free.kind > 0]
    assert np.abs(off_it).max() < 1e-12


def test_images_spread_around_folds_stay_near_where_they_were() -> None:
    """They were slid along by as much as no positive weights would: what folds comes loose."""
    rows = columns = 31
    y, x = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    mesh = Mesh(np.stack([x, y, 0.0 * x], axis=-1).reshape(-1, 3), grid_faces(rows, columns))
    slid = x + 3 * np.exp(-((x - 15.0) ** 2 + (y - 15.0) ** 2) / 50)
    smooth = np.stack([slid, y, 0.0 * x], axis=-1).reshape(-1, 3)
    torn = slid.copy()
    torn[9:22:3, 9:22:3] += 1.8
    points = on_grid(torn.ravel(), y.ravel(), rows, columns)
    assert turned_faces(mesh, points, Target(mesh)).sum() > 20
    laid = unfolded(mesh, points, Target(mesh), everywhere(mesh), *there(mesh))
    assert not laid.left.any()
    gap = np.linalg.norm(laid.points.on(mesh) - smooth, axis=1)
    assert gap.mean() < 0.1


def test_around_folds_of_a_dense_source_is_as_wide_as_of_others() -> None:
    """A round piece of a fine grid lies turned by half a turn about its middle."""
    rows = columns = 161
    y, x = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    mesh = Mesh(np.stack([x, y, 0.0 * x], axis=-1).reshape(-1, 3), grid_faces(rows, columns))
    from_middle = (x - 80) + 1j * (y - 80)
    turn = np.clip((24 - np.abs(from_middle)) / 1.5, 0, 1)
    to = from_middle * np.exp(1j * np.pi * turn) + 80 * (1 + 1j)
    points = on_grid(to.real.ravel(), to.imag.ravel(), rows, columns)
    laid = unfolded(mesh, points, Target(mesh), everywhere(mesh), *there(mesh))
    assert laid.found > 300
    assert not laid.left.any()


def test_faces_that_hardly_exist_give_way_to_those_that_surely_do() -> None:
    """The last columns run back over those before them, and take three of these along."""
    rows = columns = 31
    y, x = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    mesh = Mesh(np.stack([x, y, 0.0 * x], axis=-1).reshape(-1, 3), grid_faces(rows, columns))
    back = np.where(x > 25, 20.0 - (x - 25), np.where(x > 22, 22.0 - (x - 22) / 2, x))
    points = on_grid(back.ravel(), y.ravel(), rows, columns)
    exists, sure = np.ones(len(mesh.vertices), dtype=np.bool_), (x <= 25).ravel()
    certain = sure[mesh.faces].all(axis=1)
    assert turned_faces(mesh, points, Target(mesh))[certain].sum() > 150
    laid = unfolded(mesh, points, Target(mesh), everywhere(mesh), exists, sure)
    turned = turned_faces(mesh, laid.points, Target(mesh))
    assert not turned[certain].any()
    assert turned.any()
    assert (laid.left >= turned).all()
    clear = (x <= 5).ravel()
    assert np.allclose(laid.points.on(mesh)[clear], mesh.vertices[clear])


def test_nothing_is_sure_where_a_face_stays_turned_over(source: Mesh, target: Target) -> None:
    landed = project(source, target, (), None, source)
    moved = np.random.default_rng(5).choice(len(source.vertices), 20, replace=False)
    points = images(source, target, past_a_neighbour(source, moved))
    sure = confidence(source, replace(landed, points=points), target)
    turned = np.unique(source.faces[turned_faces(source, points, target)])
    assert (sure[turned] == 0).all()
    others = np.setdiff1d(np.arange(len(source.vertices)), turned)
    assert np.array_equal(sure[others], existence(landed)[others])
    assert np.median(sure[others]) > 0.9


def test_what_faces_lie_around_belongs_to_their_chart(source: Mesh) -> None:
    places = sheet().vertices
    mesh, far = sheet(), np.linalg.norm(places - places.mean(axis=0), axis=1)
    middle = far < 0.2 * far.max()
    ring = np.flatnonzero((~middle & (far < 0.5 * far.max()))[mesh.faces].all(axis=1))
    chart = Chart.around(mesh, ring, adjacency(mesh.faces, len(places)), 0)
    assert chart is not None
    assert len(boundary_loops(chart.corners, len(chart.z))) == 1
    assert np.isin(np.flatnonzero(middle[mesh.faces].all(axis=1)), chart.faces).all()
    mouth = boundary_loops(source.faces, len(source.vertices))[1]
    around = np.flatnonzero(np.isin(source.faces, mouth).any(axis=1))
    open_chart = Chart.around(source, around, adjacency(source.faces, len(source.vertices)), 1)
    assert open_chart is not None
    assert len(boundary_loops(open_chart.corners, len(open_chart.z))) == 2


def test_a_chart_keeps_to_one_side_of_a_vertex_where_pieces_touch() -> None:
    first = sheet()
    n = len(first.vertices)
    other = np.where(first.faces == 0, 0, first.faces + n)
    mesh = Mesh(np.concatenate([first.vertices, -first.vertices]), np.r_[first.faces, other])
    count = len(first.faces)
    wanted = np.arange(count // 2, count + count // 3)
    chart = Chart.around(mesh, wanted, adjacency(mesh.faces, 2 * n), 1)
    assert chart is not None
    assert np.isin(np.arange(count // 2, count), chart.faces).all()
    assert chart.faces.max() < count


def test_pieces_that_hang_together_by_an_edge_alone_make_no_chart() -> None:
    """A disk and a torus with a hole have the Euler characteristic of an annulus."""
    disk, ring = sheet(), torus()
    first, tip = len(disk.vertices), len(disk.vertices) + len(ring.vertices)
    pieces = np.concatenate([disk.faces, ring.faces[1:] + first])
    bridge = [[0, first + ring.faces[0, 0], tip]]
    places = np.concatenate([disk.vertices, ring.vertices + 20.0, [[5.0, 5.0, 5.0]]])
    mesh = Mesh(places, np.concatenate([pieces, bridge]))
    links = adjacency(mesh.faces, len(places))
    assert Chart.around(mesh, np.arange(len(pieces)), links, 0) is None
    assert Chart.around(mesh, np.arange(len(disk.faces)), links, 0) is not None
