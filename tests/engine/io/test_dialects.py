"""Files in all their variety: read as they are meant, written back as they were."""

from __future__ import annotations

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from engine.errors import EngineError
from engine.io import read_mesh, write_mesh
from engine.topology import disk_surface, editable_surface
from engine.types import Mesh
from tests.engine.io.contract import check
from tests.engine.io.dialects import Example, files
from tests.engine.io.variants import polygons

SLOW = [HealthCheck.too_slow, HealthCheck.data_too_large]


@settings(max_examples=300, deadline=None, suppress_health_check=SLOW)
@given(files())
def test_every_dialect_is_read_as_meant_and_written_back(example: Example) -> None:
    file = check(example.data)
    assert file is not None
    assert np.array_equal(file.mesh.vertices, example.vertices)
    assert polygons(file) == example.polygons
    proper = [polygon for polygon in example.polygons if len(polygon) >= 3]
    for format in ("obj", "ply"):
        clean = read_mesh(write_mesh(file, format=format))
        assert polygons(clean) == (proper if format == "obj" else example.polygons)
        exact = file.double
        near = 0.0 if exact else 1e-7 * float(np.abs(example.vertices).max())
        assert np.abs(clean.mesh.vertices - example.vertices).max() <= near


PIECES = st.sampled_from(
    [b"\n", b"\\", b"\r", b" ", b"-", b"99999999999", b"1e999", b"nan", b"\0", b"#", b"/"]
) | st.sampled_from(
    [b"\xff\xff\xff\xff", b"4294967296", b"property int x\n", b"element face 3\n", b"f ", b"v 1 2"]
)
EDITS = st.lists(
    st.tuples(st.integers(0, 1000), st.integers(0, 6), st.binary(max_size=6) | PIECES),
    min_size=1,
    max_size=4,
)


@settings(max_examples=300, deadline=None, suppress_health_check=SLOW)
@given(files(), EDITS)
def test_mutated_dialects_are_refused_or_kept(
    example: Example, edits: list[tuple[int, int, bytes]]
) -> None:
    data = example.data
    for place, cut, new in edits:
        at = place % (len(data) + 1)
        data = data[:at] + new + data[at + cut :]
    check(data)


@settings(max_examples=200, deadline=None)
@given(st.integers(3, 8), st.data())
def test_any_triangles_have_a_surface_or_a_reason(count: int, data: st.DataObject) -> None:
    places = st.tuples(*[st.integers(0, 3)] * 3)
    vertices = np.array(data.draw(st.lists(places, min_size=count, max_size=count)), float)
    corner = st.integers(0, count - 1)
    faces = data.draw(st.lists(st.tuples(corner, corner, corner), min_size=1, max_size=14))
    try:
        surface, _ = editable_surface(Mesh(vertices, np.array(faces)))
        disk = disk_surface(surface)
    except EngineError as refusal:
        assert refusal.code != EngineError.default_code
        assert str(refusal)
        return
    corners = surface.mesh.vertices[surface.mesh.faces]
    assert np.array_equal(
        np.sort(vertices[np.array(faces)[surface.face_of]], axis=1), np.sort(corners, axis=1)
    )
    assert len(disk.face) <= len(surface.mesh.faces)
