import numpy as np
import pytest

from engine.errors import EngineError
from engine.io import read_mesh
from engine.measures import MeasuredSurface, histogram, similarity
from engine.types import Mesh
from tests.faces import ICT_NEUTRAL


@pytest.fixture
def spread():
    rng = np.random.default_rng(0)
    mu = rng.uniform(0, 1.2, 5000) * np.exp(1j * rng.uniform(0, 7, 5000))
    return mu, rng.uniform(0.1, 3, 5000)


def test_counts_sum_to_the_faces_and_area_weights_to_one(spread):
    mu, areas = spread
    made = histogram(mu, areas, 3, 50)
    np.testing.assert_allclose(made.edges, np.arange(51) / 50)
    assert made.counts.sum() == 5000 and made.folds == 3 and made.undefined == 0
    assert made.area_weights.sum() == pytest.approx(1)
    assert made.mean == pytest.approx(np.average(abs(mu), weights=areas))
    assert made.max == abs(mu).max()
    below = abs(mu) <= made.p95
    assert areas[below].sum() / areas.sum() == pytest.approx(0.95, abs=1e-3)


def test_values_beyond_the_last_edge_are_in_the_last_bin():
    mu = np.array([0.0, 0.1, 0.25, 1.0, 7.0, np.inf, 0.3 + 0.4j])
    made = histogram(mu, np.ones(7), 2, 4)
    np.testing.assert_array_equal(made.counts, [2, 1, 1, 3])
    np.testing.assert_allclose(made.area_weights, np.array([2, 1, 1, 3]) / 7)
    assert made.undefined == 1 and made.max == 7.0


def test_own_edges_are_taken(spread):
    edges = np.array([0.0, 0.1, 0.5])
    made = histogram(*spread, 0, edges)
    np.testing.assert_array_equal(made.edges, edges)
    assert made.counts.sum() == 5000
    with pytest.raises(EngineError):
        histogram(*spread, 0, 0)


def test_a_shifted_histogram_is_as_far_away_as_its_shift():
    mu = np.random.default_rng(1).uniform(0, 0.5, 3000).astype(complex)
    areas = np.ones(3000)
    first = histogram(mu, areas, 0, 50)
    near = similarity(first, histogram(mu + 0.1, areas, 0, 50))
    assert near.wasserstein_1 == pytest.approx(0.1, abs=1e-3)
    same = similarity(first, first)
    assert (same.wasserstein_1, same.correlation) == (0.0, pytest.approx(1.0))
    assert near.correlation < same.correlation


def test_histograms_over_other_bins_are_not_compared(spread):
    with pytest.raises(EngineError):
        similarity(histogram(*spread, 0, 10), histogram(*spread, 0, 20))


def test_distance_to_a_raised_copy_is_the_height():
    x, y = (a.ravel() for a in np.meshgrid(np.arange(12.0), np.arange(12.0), indexing="ij"))
    corner = (np.arange(11)[:, None] * 12 + np.arange(11)).ravel()
    faces = np.stack([corner, corner + 12, corner + 13, corner, corner + 13, corner + 1], 1)
    flat = Mesh(np.stack([x, y, 0 * x], 1), faces.reshape(-1, 3))
    raised = flat.moved(flat.vertices + np.array([0.3, 0.2, 0.25]))
    both = MeasuredSurface(raised).distance(flat).scaled(2.0)
    for way in (both.to_target, both.from_target):
        assert 0.5 <= way.mean < 0.52
        assert way.max == pytest.approx(2 * np.sqrt(0.25**2 + 0.3**2 + 0.2**2))


def test_a_part_is_on_the_whole_but_not_the_whole_on_the_part():
    whole = read_mesh(ICT_NEUTRAL).mesh
    part = Mesh(whole.vertices, whole.faces[: len(whole.faces) // 2])
    both = MeasuredSurface(whole).distance(part)
    assert both.to_target.max < 1e-12
    assert both.from_target.max > 1.0
