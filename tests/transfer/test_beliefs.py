"""Beliefs obey the laws of probability; the conjugate update is computed by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import expit, logit

from p2l.transfer.beliefs import BetaBelief, LatentBelief, expected_success
from p2l.transfer.calibration import Platt

COVARIANCE = np.array([[1.2, 0.8, 0.0], [0.8, 0.9, 0.1], [0.0, 0.1, 0.5]])
LOGIT = np.array([0.3, -1.0, 2.0])
ALL = np.arange(3)


def latent():
    return LatentBelief(LOGIT, np.diag(COVARIANCE), lambda pair: COVARIANCE[pair])


def test_the_conjugate_update_by_hand():
    belief = BetaBelief(np.array([1.0, 3.0]), np.array([1.0, 1.0]))
    probability, means = belief.outcomes(0, 2, np.arange(2))
    np.testing.assert_allclose(probability, [1 / 3, 1 / 3, 1 / 3])
    np.testing.assert_allclose(means, [[0.25, 0.75], [0.5, 0.75], [0.75, 0.75]])


@given(st.integers(0, 2), st.integers(1, 5), st.booleans())
def test_what_is_expected_after_a_trial_is_on_average_what_is_expected_now(pair, attempts, beta):
    belief = BetaBelief(np.array([0.4, 2.0, 7.0]), np.array([1.0, 2.0, 0.5])) if beta else latent()
    probability, means = belief.outcomes(pair, attempts, ALL)
    assert probability.sum() == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(probability @ means, belief.mean, atol=1e-12 if beta else 2e-4)
    assert (np.diff(means[:, pair]) > 0.0).all()  # more successes, higher belief


def test_a_trial_moves_what_resembles_it_and_nothing_else():
    _, means = latent().outcomes(0, 3, ALL)
    assert (np.diff(means[:, 1]) > 0.0).all()
    np.testing.assert_allclose(means[:, 2], latent().mean[2], atol=1e-9)


def test_outcomes_agree_with_a_joint_normal_that_is_sampled():
    rng = np.random.default_rng(0)
    p = expit(rng.multivariate_normal(LOGIT, COVARIANCE, 400_000))
    weight = p[:, 0] ** 2 * (1.0 - p[:, 0])
    probability, means = latent().outcomes(0, 3, ALL)
    assert probability[2] == pytest.approx(3.0 * weight.mean(), abs=3e-3)
    np.testing.assert_allclose(means[2], weight @ p / weight.sum(), atol=4e-3)


@pytest.mark.parametrize("belief", [latent(), BetaBelief(np.array([0.4, 2.0, 7.0]), np.array([1.0, 2.0, 0.5]))])
def test_at_the_ends_of_its_interval_a_pair_draws_those_along_that_resemble_it(belief):
    ends, (low, high) = belief.extremes(0, 0.9, ALL), belief.interval(0.9)
    np.testing.assert_allclose(ends[:, 0], [low[0], high[0]])
    np.testing.assert_allclose(ends[:, 2], belief.mean[2], atol=0.01)
    assert ends[0, 1] <= belief.mean[1] <= ends[1, 1]
    assert (ends[1, 1] > ends[0, 1] + 0.2) == isinstance(belief, LatentBelief)


def test_intervals_hold_their_share():
    rng = np.random.default_rng(1)
    low, high = latent().interval(0.9)
    p = expit(LOGIT + np.sqrt(np.diag(COVARIANCE)) * rng.standard_normal((200_000, 3)))
    np.testing.assert_allclose(((low < p) & (p < high)).mean(axis=0), 0.9, atol=3e-3)
    low, high = BetaBelief(np.array([2.0]), np.array([5.0])).interval(0.8)
    p = rng.beta(2.0, 5.0, 200_000)
    assert ((low < p) & (p < high)).mean() == pytest.approx(0.8, abs=4e-3)


def test_a_correction_and_an_effect_of_its_own_change_logits_as_they_say():
    corrected = latent().corrected(Platt(2.0, -1.0))
    np.testing.assert_allclose(corrected.logit, 2.0 * LOGIT - 1.0)
    np.testing.assert_allclose(corrected.covariance(1), 4.0 * COVARIANCE[1])
    loosened = latent().loosened(np.array([0.0, 0.3, 0.0]))
    np.testing.assert_allclose(loosened.variance, np.diag(COVARIANCE) + [0.0, 0.3, 0.0])
    np.testing.assert_allclose(loosened.covariance(1), COVARIANCE[1] + [0.0, 0.3, 0.0])


def test_a_certain_logit_is_its_own_expectation():
    p = np.array([0.01, 0.5, 0.9])
    np.testing.assert_allclose(expected_success(logit(p), np.zeros(3)), p, atol=1e-12)
