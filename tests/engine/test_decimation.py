import numpy as np
import pytest

from engine.decimation import decimate
from engine.operators import face_areas, face_normals
from engine.topology import boundary_loops
from engine.types import Mesh
from tests.engine.remeshed import face, subdivided, surface_of
from tests.faces import ICT_NEUTRAL


@pytest.fixture(scope="module")
def dense() -> Mesh:
    return subdivided(face(ICT_NEUTRAL))


def test_a_decimated_face_is_the_same_surface(dense: Mesh) -> None:
    loops = boundary_loops(dense.faces, len(dense.vertices))
    kept, faces = decimate(dense, loops, 2000)
    assert len(kept) == 2000
    assert np.array_equal(np.unique(faces), np.arange(2000))
    small = Mesh(dense.vertices[kept], faces)
    assert len(surface_of(small).loops) == len(loops)
    assert face_areas(small).sum() == pytest.approx(face_areas(dense).sum(), rel=0.02)
    assert (face_normals(small)[:, 2] > 0).mean() == pytest.approx(
        (face_normals(dense)[:, 2] > 0).mean(), abs=0.05
    )


def test_vertices_without_faces_change_nothing(dense: Mesh) -> None:
    loops = boundary_loops(dense.faces, len(dense.vertices))
    lone = Mesh(np.concatenate([np.zeros((7, 3)), dense.vertices]), dense.faces + 7)
    kept, faces = decimate(dense, loops, 3000)
    others, same = decimate(lone, [loop + 7 for loop in loops], 3000)
    assert np.array_equal(others, kept + 7)
    assert np.array_equal(same, faces)


def test_what_has_few_vertices_stays() -> None:
    plate = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 9, 9]], [[0, 1, 2]])
    kept, faces = decimate(plate, [np.array([0, 1, 2])], 3)
    assert kept.tolist() == [0, 1, 2]
    assert faces.tolist() == [[0, 1, 2]]


def test_borders_of_which_no_loop_is_given_stay(dense: Mesh) -> None:
    border = np.concatenate(boundary_loops(dense.faces, len(dense.vertices)))
    kept, _ = decimate(dense, (), 3000)
    assert len(kept) < len(dense.vertices) / 2
    assert np.isin(border, kept).all()
