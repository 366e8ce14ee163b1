import numpy as np
import pytest
from scipy.linalg import polar

from engine.io import read_mesh
from engine.operators import face_normals
from engine.restoration import Orientation
from engine.restoration._apart_kernels import least_stretches, rotations_and_stretches
from engine.restoration._frames import frames_of
from engine.types import Mesh
from tests.faces import ICT_JAW_OPEN, ICT_NEUTRAL


@pytest.fixture(scope="module")
def face():
    return read_mesh(ICT_NEUTRAL).mesh


def roughened(amount):
    vertices = read_mesh(ICT_JAW_OPEN).mesh.vertices
    return vertices + amount * np.random.default_rng(3).normal(size=vertices.shape)


def gradients(mesh, frames, shape):
    """Deformation gradients (m, 3, 3), normals going to normals as large as sides are."""
    images = np.einsum("mka,mkc->mac", shape[mesh.faces], frames.hats)
    normal = np.cross(images[..., 0], images[..., 1])
    normal /= np.sqrt(np.linalg.norm(normal, axis=1, keepdims=True))
    across = np.cross(frames.tangents[..., 0], frames.tangents[..., 1])
    return images @ frames.tangents.swapaxes(1, 2) + normal[..., None] * across[:, None]


@pytest.mark.parametrize("amount", [0.0, 0.05, 0.5])
def test_faces_are_taken_apart_into_polar_factors(face, amount):
    frames, shape = frames_of(face), roughened(amount)
    rotations, stretches, mean = rotations_and_stretches(face.faces, frames, shape)
    full = gradients(face, frames, shape)
    np.testing.assert_allclose(mean, np.einsum("m,mac->ac", frames.areas, full), rtol=1e-9)
    for f in range(0, len(full), 50):
        rotation, stretch = polar(full[f])
        np.testing.assert_allclose(rotations[f], rotation, atol=1e-7)
        own = frames.tangents[f].T @ stretch @ frames.tangents[f]
        found = [[stretches[f, 0], stretches[f, 1]], [stretches[f, 1], stretches[f, 2]]]
        np.testing.assert_allclose(found, own, atol=1e-7)
    smallest = np.linalg.svd(np.einsum("mka,mkc->mac", shape[face.faces], frames.hats))[1][:, 1]
    np.testing.assert_allclose(least_stretches(stretches[None]), smallest, atol=1e-9)


def test_faces_that_a_shape_crushes_are_still_turned_with_their_normal(face):
    shape = roughened(0.0)
    first, second = face.faces[100], face.faces[9000]
    shape[first] = shape[first[0]]
    shape[second[2]] = 0.5 * (shape[second[0]] + shape[second[1]])
    rotations, stretches, _ = rotations_and_stretches(face.faces, frames_of(face), shape)
    assert np.isfinite(stretches).all()
    unit = rotations @ rotations.swapaxes(1, 2)
    np.testing.assert_allclose(unit, np.broadcast_to(np.eye(3), unit.shape), atol=1e-9)
    assert (np.linalg.det(rotations) > 0).all()


@pytest.mark.parametrize("amount", [0.0, 0.02, 0.1, 0.5])
def test_whether_a_face_is_turned_over_is_told_as_by_its_neighbourhoods_rotation(face, amount):
    orientation, shape = Orientation(face), roughened(amount)
    shown = np.einsum("ma,ma->m", orientation.up(shape), face_normals(Mesh(shape, face.faces)))
    told = orientation.turned(shape, least_area_ratio=0.0)
    np.testing.assert_array_equal(told, np.flatnonzero(shown < 0))
    assert len(told) > 50 or amount == 0.0
