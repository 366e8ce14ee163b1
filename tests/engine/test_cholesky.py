import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st
from threadpoolctl import threadpool_info, threadpool_limits

from engine.cholesky import analyse, factorise, pivots, solve
from engine.cholesky._graph_kernels import adjacency
from engine.cholesky._ordering_kernels import nested_dissection
from engine.cholesky._threads import one_thread


def lower(matrix):
    triangle = sp.tril(sp.csc_array(matrix), format="csc")
    triangle.sort_indices()
    return triangle.indptr.astype(np.int64), triangle.indices.astype(np.int64), triangle.data


def grid(width, height, seed=0):
    """A definite matrix on a triangulated grid whose vertices are numbered at random."""
    rng = np.random.default_rng(seed)
    at = np.arange(width * height).reshape(height, width)
    edges = np.concatenate(
        [
            np.stack([at[:, :-1].ravel(), at[:, 1:].ravel()]),
            np.stack([at[:-1].ravel(), at[1:].ravel()]),
            np.stack([at[:-1, :-1].ravel(), at[1:, 1:].ravel()]),
        ],
        axis=1,
    )
    edges = rng.permutation(at.size)[edges]
    weights = rng.uniform(0.1, 3, edges.shape[1])
    half = sp.coo_array((-weights, edges), shape=(at.size, at.size))
    whole = sp.csc_array(half + half.T)
    return whole + sp.diags_array(0.1 - whole.sum(axis=0))


def random_definite(n, density, seed):
    rows = sp.random_array((n, n), density=density, rng=np.random.default_rng(seed), format="csc")
    return rows @ rows.T + sp.eye_array(n)


def arrow(n):
    matrix = sp.lil_array(sp.diags_array(np.full(n, float(n))))
    matrix[0, :] = matrix[:, 0] = 1
    matrix[0, 0] = n
    return matrix


MATRICES = {
    "one": sp.csc_array([[4.0]]),
    "diagonal": sp.diags_array(np.arange(1.0, 90)),
    "arrow": arrow(300),
    "grid": grid(40, 31),
    "long grid": grid(3, 400),
    "two pieces": sp.block_diag([grid(20, 20), grid(15, 9)]),
    "three unknowns a vertex": sp.kron(grid(20, 17), np.eye(3) + 1.0),
    "dense": random_definite(120, 0.5, 1),
    "random": random_definite(400, 0.004, 2),
}


@pytest.mark.parametrize("name", MATRICES)
@pytest.mark.parametrize("once", [False, True])
def test_the_factor_is_the_permuted_matrixs(name, once):
    indptr, indices, data = lower(MATRICES[name])
    matrix = sp.csc_array(MATRICES[name]).toarray()
    analysis = analyse(indptr, indices, once=once)
    panels, failed, _ = factorise(analysis, data)
    assert failed == -1
    order = analysis.order
    assert np.array_equal(np.sort(order), np.arange(len(matrix)))
    exact = scipy.linalg.cholesky(matrix[np.ix_(order, order)], lower=True)
    np.testing.assert_allclose(pivots(analysis, panels)[order], np.diag(exact) ** 2, rtol=1e-11)
    for count in (1, 2, 3, 11):
        right = np.random.default_rng(count).normal(size=(len(matrix), count))
        x = solve(analysis, panels, right)
        np.testing.assert_allclose(matrix @ x, right, atol=1e-11 * np.abs(matrix).max())


@given(st.integers(1, 40), st.floats(0.0, 0.4), st.integers(0, 10**6))
def test_any_pattern_is_solved(n, density, seed):
    matrix = random_definite(n, density, seed)
    indptr, indices, data = lower(matrix)
    analysis = analyse(indptr, indices)
    panels, failed, _ = factorise(analysis, data)
    right = np.ones((n, 1))
    assert failed == -1
    np.testing.assert_allclose(matrix @ solve(analysis, panels, right), right, atol=1e-9)


def test_nothing_is_solved_for_no_unknowns():
    none = np.zeros(0, np.int64)
    analysis = analyse(np.zeros(1, np.int64), none)
    panels, failed, _ = factorise(analysis, np.zeros(0))
    assert failed == -1 and solve(analysis, panels, np.zeros((0, 2))).shape == (0, 2)


@pytest.mark.parametrize("at", [0, 700, 1239])
def test_elimination_names_a_pivot_that_is_not_positive(at):
    indptr, indices, data = lower(grid(40, 31))
    analysis = analyse(indptr, indices)
    data[indptr[at]] = -1e6
    _, failed, pivot = factorise(analysis, data)
    assert failed == at and pivot < -9e5


def test_a_grid_fills_as_little_as_nested_dissection_promises():
    """George 1973: at most 31/4 n log2 n entries for n unknowns of a square grid. Good separators
    need far fewer (METIS, in the same supernodes, .37 of it), a poor order several times as many.
    """
    indptr, indices, _ = lower(grid(100, 100))
    for once in (False, True):
        analysis = analyse(indptr, indices, once=once)
        wide, high = np.diff(analysis.first), np.diff(analysis.bound)
        stored = (wide * high).sum() + (wide * (wide + 1) // 2).sum()
        assert stored < 0.4 * 31 / 4 * 1e4 * np.log2(1e4)


def test_separators_leave_parts_that_do_not_touch():
    indptr, indices, _ = lower(grid(60, 60))
    start, neighbours = adjacency(indptr, indices)
    links = neighbours.astype(np.int32)
    order = nested_dissection(start, links, np.ones(3600, np.int64), 4)
    place = np.argsort(order)
    separator = next(k for k in range(20, 300) if _falls_apart(start, neighbours, place, k))
    assert separator <= 75


def _falls_apart(start, neighbours, place, last):
    """Whether the graph without its ``last`` nodes in order is two parts of similar size."""
    n = len(place)
    rows = np.repeat(np.arange(n), np.diff(start))
    kept = (place[rows] < n - last) & (place[neighbours] < n - last)
    graph = sp.coo_array((np.ones(kept.sum()), (rows[kept], neighbours[kept])), shape=(n, n))
    _, label = sp.csgraph.connected_components(graph)
    sizes = np.sort(np.bincount(label))
    return sizes[-2] > 0.35 * n


def test_blas_is_on_one_thread_while_anyone_factors_and_then_as_before():
    def counts() -> set[int]:
        return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}

    with threadpool_limits(limits=2, user_api="blas"):
        with pytest.raises(ValueError, match="inside"), one_thread:
            with one_thread:
                assert counts() == {1}
            assert counts() == {1}
            raise ValueError("inside")
        assert counts() == {2}
