"""Scores against hand-computed values and naive versions; laws of Platt's correction."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis.extra.numpy import arrays
from scipy.special import expit, logit
from sklearn.metrics import brier_score_loss, roc_auc_score
from sklearn.metrics import log_loss as sklearn_log_loss

from p2l.transfer.calibration import Platt, auc, bins_of, brier, ece, fit_platt, log_loss, reliability

DRAWS = 4
N = 12
# Few distinct values, so that ties happen.
probabilities = arrays(float, N, elements=st.sampled_from([0.05, 0.2, 0.35, 0.5, 0.71, 0.9]))
counts = arrays(np.int64, N, elements=st.integers(0, DRAWS))
multiplicities = arrays(np.int64, N, elements=st.integers(0, 3))


def _single(p, successes):
    """Every execution as a row of its own: the naive form of all scores."""
    outcomes = np.concatenate([np.r_[np.ones(s), np.zeros(DRAWS - s)] for s in successes])
    return np.repeat(p, DRAWS), outcomes


@given(probabilities, counts)
def test_scores_equal_those_of_single_executions(p, successes):
    q, outcomes = _single(p, successes)
    assert brier(p, successes, DRAWS) == pytest.approx(brier_score_loss(outcomes, q))
    assert log_loss(p, successes, DRAWS) == pytest.approx(sklearn_log_loss(outcomes, q, labels=[0, 1]))
    if 0 < outcomes.sum() < len(outcomes):
        assert auc(p, successes, DRAWS) == pytest.approx(roc_auc_score(outcomes, q))
    else:
        assert np.isnan(auc(p, successes, DRAWS))


@given(probabilities, counts, multiplicities)
def test_weights_act_like_repeated_pairs(p, successes, times):
    if times.sum() == 0:
        times[0] = 1
    repeated = np.repeat(p, times), np.repeat(successes, times), DRAWS
    weights = np.stack([times, 2 * times]).astype(float)
    for score in (brier, log_loss, ece, auc):
        expected = score(*repeated)
        np.testing.assert_allclose(score(p, successes, DRAWS, weights), [expected, expected], atol=1e-12)


@given(probabilities, counts)
def test_brier_is_reliability_minus_resolution_plus_uncertainty(p, successes):
    rate = successes / DRAWS
    base = rate.mean()
    within = [p == value for value in np.unique(p)]
    rates = np.array([rate[rows].mean() for rows in within])
    share = np.array([rows.mean() for rows in within])
    decomposed = share @ (np.unique(p) - rates) ** 2 - share @ (rates - base) ** 2 + base * (1 - base)
    assert brier(p, successes, DRAWS) == pytest.approx(decomposed)


def test_ece_and_reliability_by_hand():
    p = np.array([0.1, 0.12, 0.95, 1.0])
    successes = np.array([0, 2, 4, 3])
    # bin 1: mean 0.11, rate 0.25; bin 9: mean 0.975, rate 0.875; half of the executions each
    assert ece(p, successes, DRAWS) == pytest.approx(0.5 * 0.14 + 0.5 * 0.1)
    curve = reliability(p, successes, DRAWS)
    assert curve.pairs.tolist() == [0, 2, 0, 0, 0, 0, 0, 0, 0, 2]
    assert curve.executions.tolist() == [0, 8, 0, 0, 0, 0, 0, 0, 0, 8]
    assert (curve.mean_p[1], curve.rate[1], curve.rate[9]) == (pytest.approx(0.11), 0.25, 0.875)
    assert np.isnan(curve.rate[0])
    assert bins_of(np.array([0.0, 0.1, 1.0]), 10).tolist() == [0, 1, 9]


@given(probabilities, counts)
def test_reliability_loses_no_execution(p, successes):
    curve = reliability(p, successes, DRAWS)
    assert curve.successes.sum() == successes.sum()
    assert curve.executions.sum() == N * DRAWS


@settings(max_examples=50, deadline=None)
@given(arrays(float, N, elements=st.floats(-8, 8)), counts)
def test_correction_keeps_the_ranking_and_does_not_hurt(z, successes):
    platt = fit_platt(z, successes, DRAWS)
    assert platt.slope > 0
    order = np.argsort(z, kind="stable")
    assert np.all(np.diff(platt(z)[order]) >= 0)
    # the small ridge may cost what it is worth at the identity: nothing
    assert log_loss(platt(z), successes, DRAWS) <= log_loss(expit(z), successes, DRAWS) + 1e-6


def test_correction_recovers_a_known_distortion():
    rng = np.random.default_rng(0)
    truth = rng.uniform(0.02, 0.98, 4000)
    successes = rng.binomial(20, truth)
    distorted = (logit(truth) - 0.7) * 2.5
    platt = fit_platt(distorted, successes, 20)
    np.testing.assert_allclose([platt.slope, platt.shift], [0.4, 0.7], rtol=0.05)
    assert ece(platt(distorted), successes, 20) < 0.02 < ece(expit(distorted), successes, 20)


@pytest.mark.parametrize("successes", [np.zeros(N, int), np.full(N, DRAWS)])
def test_correction_of_one_sided_data_is_finite(successes):
    platt = fit_platt(np.linspace(-3, 3, N), successes, DRAWS)
    assert np.isfinite(platt(np.array([-50.0, 0.0, 50.0]))).all()


def test_the_identity_is_the_default():
    z = np.array([-1.0, 0.0, 2.0])
    np.testing.assert_allclose(Platt()(z), expit(z))
