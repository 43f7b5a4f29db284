"""Gaussian process classification against numeric derivatives and brute-force integrals."""

import numpy as np
import pytest
from scipy.special import expit

from p2l.transfer.few_trials import pairs_of
from p2l.transfer.kernels import linear_kernel, smooth_kernel
from p2l.transfer.processes import belief_of, expectation_propagation, fit_process, mode_at
from tests.transfer import shop


@pytest.fixture(scope="module")
def example():
    rng = np.random.default_rng(0)
    tasks = shop.table(rng)
    trials = shop.tried(shop.truth(tasks, rng), rng, 30)
    return tasks, trials, pairs_of(tasks, trials.taught, trials.tested)


@pytest.mark.parametrize("make", [linear_kernel, smooth_kernel])
def test_the_gradient_of_the_evidence_is_its_numeric_derivative(example, make):
    _, trials, pairs = example
    kernel = make(2, 3)
    mean = np.full(len(pairs), -0.5)

    def evidence(theta):
        return mode_at(kernel, theta, pairs, mean, trials.successes, trials.attempts, mean).evidence

    theta, step = kernel.centre + 0.1, 1e-5
    gradient = mode_at(kernel, theta, pairs, mean, trials.successes, trials.attempts, mean).gradient
    numeric = [(evidence(theta + move) - evidence(theta - move)) / (2 * step) for move in step * np.eye(len(theta))]
    np.testing.assert_allclose(gradient, numeric, atol=1e-6)


@pytest.mark.parametrize("make", [linear_kernel, smooth_kernel])
def test_a_kernel_is_a_covariance_and_its_diagonal_is_that_of_its_matrix(example, make):
    _, _, pairs = example
    kernel = make(2, 3)
    matrix = kernel.value(kernel.centre, pairs, pairs)
    assert np.linalg.eigvalsh(matrix).min() > -1e-9
    np.testing.assert_allclose(kernel.diagonal(kernel.centre, pairs), np.diag(matrix), atol=1e-9)


def test_expectation_propagation_has_the_moments_of_the_exact_posterior():
    """Two pairs, one with failures only: the integral is summed on a grid."""
    covariance, mean = np.array([[2.0, 1.2], [1.2, 1.5]]), np.array([0.5, -0.5])
    wins, total = np.array([0, 2]), np.array([6, 3])
    posterior = expectation_propagation(covariance, mean, wins, total, mean)
    axis = np.linspace(-9.0, 9.0, 601)
    f = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    away = f - mean
    log_weight = -0.5 * np.einsum("qi,ij,qj->q", away, np.linalg.inv(covariance), away)
    log_weight += (wins * f - total * np.logaddexp(0.0, f)).sum(axis=1)
    weight = np.exp(log_weight - log_weight.max())
    weight /= weight.sum()
    exact = weight @ f
    left = covariance - covariance @ posterior.precision @ covariance
    np.testing.assert_allclose(mean + covariance @ posterior.weight, exact, atol=0.02)
    np.testing.assert_allclose(np.diag(left), weight @ (f - exact) ** 2, rtol=0.05)


def test_the_covariance_of_a_belief_is_consistent_with_its_variances(example):
    tasks, trials, pairs = example
    kernel = smooth_kernel(2, 3)
    mean = np.full(len(pairs), -0.5)
    theta, posterior = fit_process(kernel, pairs, mean, trials.successes, trials.attempts)
    query = pairs_of(tasks, np.array([0, 0, 1, *trials.taught[:2]]), np.array([1, 2, 2, *trials.tested[:2]]))
    belief = belief_of(kernel, theta, posterior, pairs, query, np.full(5, -0.5))
    matrix = np.array([belief.covariance(pair) for pair in range(5)])
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-9)
    np.testing.assert_allclose(np.diag(matrix), belief.variance)
    assert np.linalg.eigvalsh(matrix).min() > 0.0


@pytest.mark.parametrize(("wins", "total"), [(3000, 10_000), (10_000, 10_000), (0, 1)])
def test_one_pair_is_as_sure_as_its_counts_allow(wins, total):
    """Against an integral of one dimension."""
    posterior = expectation_propagation(np.eye(1) * 4.0, np.zeros(1), np.array([wins]), np.array([total]), np.zeros(1))
    f = np.linspace(-12.0, 12.0, 400_001)
    log_weight = wins * f - total * np.logaddexp(0.0, f) - f**2 / 8.0
    weight = np.exp(log_weight - log_weight.max())
    mean = (weight * f).sum() / weight.sum()
    assert 4.0 * posterior.weight[0] == pytest.approx(mean, abs=2e-3)
    variance = (weight * (f - mean) ** 2).sum() / weight.sum()
    assert 4.0 - 16.0 * posterior.precision[0, 0] == pytest.approx(variance, rel=0.02)


def test_many_trials_of_one_pair_leave_little_doubt(example):
    tasks, _, _ = example
    pair = pairs_of(tasks, np.array([0]), np.array([1]))
    kernel = linear_kernel(2, 3)
    theta, posterior = fit_process(kernel, pair, np.zeros(1), np.array([600]), np.array([2000]))
    belief = belief_of(kernel, theta, posterior, pair, pair, np.zeros(1))
    assert expit(belief.logit[0]) == pytest.approx(0.3, abs=0.01)
    assert belief.interval(0.9)[1][0] - belief.interval(0.9)[0][0] < 0.04
