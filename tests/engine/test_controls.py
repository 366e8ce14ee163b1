import numpy as np
import pytest

from engine.controls import (
    AddressedMesh,
    PolygonAddress,
    PositionAddress,
    VertexAddress,
    distance_weights,
    interpolate_controls,
    resolve,
    spread_points,
)
from engine.errors import ControlPointError
from engine.io import read_mesh
from engine.topology import editable_surface
from tests.faces import HEAD_NEUTRAL


@pytest.fixture(scope="module")
def head() -> AddressedMesh:
    file = read_mesh(HEAD_NEUTRAL)
    surface, _ = editable_surface(file.mesh)
    return AddressedMesh(file.mesh, file.first_face, file.polygon_of, surface)


def test_the_four_corners_of_a_quad_and_its_first_three_say_the_same(head: AddressedMesh) -> None:
    addresses = [
        PolygonAddress(10, (0.2, 0.3, 0.5)),
        PolygonAddress(10, (0.2, 0.3, 0.5, 0.0)),
    ]
    points, snap = resolve(addresses, ["three", "four"], head)
    a, b = points.on(head.surface.mesh)
    assert np.allclose(a, b, atol=1e-12)
    assert snap.max() < 1e-12


def test_a_vertex_is_met_exactly_and_a_position_is_snapped(head: AddressedMesh) -> None:
    vertex = int(np.flatnonzero(head.surface.vertex_of >= 0)[100])
    here = head.mesh.vertices[vertex]
    outside = PositionAddress(tuple(here + 1e-3))
    points, snap = resolve([VertexAddress(vertex), outside], ["v", "p"], head)
    assert np.array_equal(points.on(head.surface.mesh)[0], here)
    assert sorted(points.barycentric[0]) == [0.0, 0.0, 1.0]
    assert 0 < snap[1] <= np.sqrt(3) * 1e-3


def test_every_bad_address_is_named_with_what_is_wrong(head: AddressedMesh) -> None:
    with pytest.raises(ControlPointError) as caught:
        resolve(
            [VertexAddress(10**6), PositionAddress((0, 0, 0)), VertexAddress(0)],
            ["far", "origin", "fine"],
            head,
        )
    assert caught.value.elements["points"] == ["far", "origin"]
    with pytest.raises(ControlPointError, match="max_snap"):
        resolve([PositionAddress((0, 0, 0))], ["origin"], head)


def test_a_point_on_an_eyeball_is_not_on_the_editable_surface(head: AddressedMesh) -> None:
    passenger = int(np.flatnonzero(head.surface.vertex_of < 0)[0])
    with pytest.raises(ControlPointError) as caught:
        resolve([VertexAddress(passenger)], ["eye"], head)
    assert caught.value.code == "not_on_surface"


def test_equation_7() -> None:
    start, end = np.array([0.1 + 0.2j, 0.5j]), np.array([0.3 + 0.2j, 0.1j])
    alpha = np.array([[0.5, 0.25], [1.0, 0.0]])
    moved = interpolate_controls(start, [end, start], alpha)
    assert np.allclose(moved, start + alpha[0] * (end - start))


def test_distances_are_shares_of_each_points_way_and_never_overshoot() -> None:
    lengths = np.array([0.0, 1.0, 2.0, 4.0])
    assert np.allclose(distance_weights(1.0, lengths, 1), [0.0, 1.0, 0.5, 0.25])
    assert np.allclose(distance_weights(1.0, lengths, 2), [0.0, 0.5, 0.25, 0.125])


def test_points_spread_where_they_may_and_densest_where_it_matters() -> None:
    random = np.random.default_rng(3)
    positions = random.uniform(-1, 1, (4000, 3)) * (1, 1, 0)
    right = positions[:, 0] > 0
    allowed = positions[:, 1] > -0.5
    importance = np.where(right, 3.0, 0.0)
    chosen = spread_points(positions, importance, 100, np.array([], dtype=int), allowed)
    assert len(np.unique(chosen)) == 100
    assert allowed[chosen].all()
    assert right[chosen].sum() > 4 * (~right[chosen]).sum()
