import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from p2l.errors import ConfigError, ShapeError
from p2l.skills.reps import (
    SearchDistribution,
    divergence,
    dual,
    relative_entropy,
    sample_weights,
    solve_temperature,
    update,
)

returns_strategy = arrays(np.float64, st.integers(2, 60), elements=st.floats(-1e3, 1e3, width=32))


@given(returns=returns_strategy, epsilon=st.floats(0.05, 2.0))
@settings(max_examples=200, deadline=None)
def test_the_weights_meet_the_bound_on_relative_entropy(returns, epsilon):
    weights = sample_weights(returns, solve_temperature(returns, epsilon))
    assert weights.sum() == pytest.approx(1.0)
    assert relative_entropy(weights) <= epsilon + 1e-3


@given(returns=returns_strategy)
@settings(max_examples=100, deadline=None)
def test_the_bound_is_active_unless_the_best_samples_already_meet_it(returns):
    epsilon = 0.3
    temperature = solve_temperature(returns, epsilon)
    weights = sample_weights(returns, temperature)
    best_only = np.isclose(returns, returns.max(), atol=0.0, rtol=0.0)
    greedy_entropy = np.log(len(returns) / best_only.sum())
    # Near-ties below the least temperature, or below the search's range of e⁻¹² of the spread, are not told apart.
    free = temperature > max(1.01e-5, np.ptp(returns) * np.exp(-11.5))
    if free and np.ptp(returns) > 1e-6 and greedy_entropy > epsilon + 0.05:
        assert relative_entropy(weights) == pytest.approx(epsilon, abs=5e-3)


def test_the_temperature_minimises_the_dual():
    returns = np.array([0.0, 0.2, 0.5, 1.0, 1.3])
    eta = solve_temperature(returns, 0.4)
    around = [dual(eta * factor, returns, 0.4) for factor in (0.8, 0.95, 1.0, 1.05, 1.25)]
    assert min(around) == around[2]


def test_two_samples_by_hand():
    """With two samples KL(w ‖ uniform) = Σ w log 2w; the weights that meet ε = 0.2 solve it, whatever the scale."""
    for scale in (1e-3, 1.0, 1e4):
        weights = sample_weights(np.array([0.0, scale]), solve_temperature(np.array([0.0, scale]), 0.2, 1e-12))
        assert relative_entropy(weights) == pytest.approx(0.2, abs=1e-4)
        assert weights[1] > weights[0]


def test_equal_returns_leave_the_mean_of_the_samples():
    search = SearchDistribution(np.zeros(3), np.eye(3))
    samples = search.sample(np.random.default_rng(0), 50)
    moved = update(search, samples, np.ones(50), epsilon=0.5)
    np.testing.assert_allclose(moved.mean, samples.mean(0))
    np.testing.assert_allclose(np.diag(moved.covariance), samples.var(0, ddof=1), rtol=1e-6)


def test_it_climbs_a_quadratic():
    rng = np.random.default_rng(1)
    optimum = np.array([1.0, -2.0, 0.5])
    search = SearchDistribution(np.zeros(3), np.eye(3))
    for _ in range(30):
        samples = search.sample(rng, 60)
        returns = -((samples - optimum) ** 2).sum(1)
        search = update(search, samples, returns, epsilon=0.7, shrinkage=0.5, floor=np.full(3, 1e-6))
    np.testing.assert_allclose(search.mean, optimum, atol=0.05)


def test_the_covariance_stays_positive_definite_with_few_samples():
    search = SearchDistribution(np.zeros(10), np.eye(10))
    rng = np.random.default_rng(2)
    for _ in range(5):
        samples = search.sample(rng, 4)
        search = update(search, samples, samples[:, 0], epsilon=1.0, shrinkage=0.3, floor=np.full(10, 1e-3))
        assert np.linalg.eigvalsh(search.covariance).min() > 0.0


def test_bad_input_is_refused():
    search = SearchDistribution(np.zeros(2), np.eye(2))
    with pytest.raises(ConfigError, match="must be positive"):
        solve_temperature(np.ones(3), 0.0)
    with pytest.raises(ShapeError, match="NaN"):
        update(search, np.zeros((2, 2)), np.array([0.0, np.nan]), epsilon=0.5)
    with pytest.raises(ShapeError, match="axis 0"):
        update(search, np.zeros((2, 2)), np.zeros(3), epsilon=0.5)
    with pytest.raises(ConfigError, match="shrinkage"):
        update(search, np.zeros((2, 2)), np.zeros(2), epsilon=0.5, shrinkage=2.0)


def test_the_divergence_of_gaussians_by_hand_and_by_torch():
    one = SearchDistribution(np.array([1.0]), np.array([[4.0]]))
    other = SearchDistribution(np.array([0.0]), np.array([[1.0]]))
    assert divergence(one, other) == pytest.approx(0.5 * (4.0 + 1.0 - 1.0 - np.log(4.0)))
    assert divergence(one, one) == pytest.approx(0.0, abs=1e-12)
    import torch

    rng = np.random.default_rng(0)
    drawn = []
    for _ in range(2):
        root = rng.normal(size=(5, 5))
        drawn.append(SearchDistribution(rng.normal(size=5), root @ root.T + np.eye(5)))
    normal = [
        torch.distributions.MultivariateNormal(torch.tensor(np.array(d.mean)), torch.tensor(np.array(d.covariance)))
        for d in drawn
    ]
    assert divergence(*drawn) == pytest.approx(float(torch.distributions.kl_divergence(*normal)), rel=1e-9)
