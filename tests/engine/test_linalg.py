import pickle

import numpy as np
import pytest
import scipy.sparse as sp

from engine.errors import NumericalError
from engine.linalg import ElementPattern, FixedSolver, SymmetricPattern


def random_definite(n: int, seed: int) -> sp.csr_array:
    rows = sp.random_array((n, n), density=4 / n, rng=np.random.default_rng(seed), format="csr")
    return sp.csr_array(rows @ rows.T + sp.eye_array(n))


@pytest.mark.parametrize("shape", [(60,), (60, 1), (60, 5)])
def test_solution_satisfies_the_system(shape):
    matrix = random_definite(60, 0)
    pattern, data = SymmetricPattern.of(matrix)
    rng = np.random.default_rng(1)
    right = rng.normal(size=shape) + 1j * rng.normal(size=shape)
    factor = pattern.factor(data)
    for b in (right, right.real.copy(), np.asfortranarray(right)):
        x = factor.solve(b)
        assert x.shape == b.shape and x.dtype == b.dtype
        np.testing.assert_allclose(matrix @ x, b, atol=1e-12)


def test_one_pattern_factors_many_values():
    matrix = random_definite(40, 2)
    pattern, data = SymmetricPattern.of(matrix)
    right = np.arange(40.0)
    once = pattern.factor(data).solve(right)
    shifted = data.copy()
    shifted[pattern.diagonal] += 3
    x = pattern.factor(shifted).solve(right)
    np.testing.assert_allclose(matrix @ x + 3 * x, right, atol=1e-11)
    np.testing.assert_array_equal(pattern.factor(data).solve(right), once)


@pytest.mark.parametrize(
    ("change", "code", "unknowns"),
    [(-1e3, "not_definite", range(3, 6)), (None, "singular", range(10))],
)
def test_matrices_that_are_not_definite_are_refused(change, code, unknowns):
    path = sp.diags_array(
        [np.full(9, -1.0), np.r_[1, np.full(8, 2.0), 1], np.full(9, -1.0)], offsets=[-1, 0, 1]
    )
    pattern, data = SymmetricPattern.of(sp.csr_array(path))
    if change is not None:
        data[pattern.diagonal[4]] = change
    with pytest.raises(NumericalError) as caught:
        pattern.factor(data)
    assert caught.value.code == code
    assert caught.value.elements["unknowns"][0] in unknowns
    assert pickle.loads(pickle.dumps(caught.value)).elements == caught.value.elements


def test_values_that_are_not_finite_do_not_pass():
    pattern, data = SymmetricPattern.of(random_definite(10, 3))
    with pytest.raises(NumericalError):
        pattern.factor(data).solve(np.full(10, np.nan))


def test_fixed_values_stay_and_free_rows_are_solved():
    matrix = random_definite(50, 4)
    rng = np.random.default_rng(5)
    fixed = rng.permutation(50)[:12]
    values, source = rng.normal(size=(12, 2)), rng.normal(size=(50, 2))
    solver = FixedSolver(matrix, fixed)
    x = solver.solve(values, source=source)
    np.testing.assert_array_equal(x[fixed], values)
    np.testing.assert_allclose((matrix @ x)[solver.free], source[solver.free], atol=1e-12)
    z = solver.solve(values[:, 0] + 1j * values[:, 1])
    np.testing.assert_allclose(z.imag, solver.solve(values[:, 1]), atol=1e-14)


def test_everything_fixed_leaves_nothing_to_solve():
    values = np.arange(6.0)
    solver = FixedSolver(random_definite(6, 6), np.arange(6))
    np.testing.assert_array_equal(solver.solve(values), values)


def test_element_blocks_sum_to_the_dense_matrix():
    rng = np.random.default_rng(7)
    n, count, k = 30, 80, 4
    dofs = np.stack([rng.permutation(n)[:k] for _ in range(count)])
    dofs[rng.random(dofs.shape) < 0.2] = -1
    blocks = rng.normal(size=(count, k, k))
    blocks += blocks.transpose(0, 2, 1)
    dense = np.zeros((n, n))
    for element, block in zip(dofs, blocks, strict=True):
        free = np.flatnonzero(element >= 0)
        dense[np.ix_(element[free], element[free])] += block[np.ix_(free, free)]
    pattern = ElementPattern(dofs, n)
    data = pattern.assemble(blocks)
    lower = sp.csc_array((data, pattern.indices, pattern.indptr), shape=(n, n)).toarray()
    np.testing.assert_allclose(lower, np.tril(dense), atol=1e-13)
    data[pattern.indptr[:-1]] += 100
    x = pattern.analyse().factor(data).solve(np.ones(n))
    np.testing.assert_allclose(dense @ x + 100 * x, 1, atol=1e-12)
