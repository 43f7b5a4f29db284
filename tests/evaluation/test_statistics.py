"""Known values and laws of the intervals."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import arrays

from p2l.errors import ShapeError
from p2l.evaluation.statistics import (
    bootstrap_interval,
    mean_interval,
    paired_difference,
    rate_interval,
    resample_weights,
    t_interval,
    wilson_interval,
)

finite = st.floats(-100, 100)


def test_wilson_known_values():
    # 8 of 10 and 0 of 10 as tabulated for the score interval at 95 %
    low, high = wilson_interval([8, 0, 10], 10)
    np.testing.assert_allclose(low, [0.4902, 0.0, 0.7225], atol=1e-4)
    np.testing.assert_allclose(high, [0.9433, 0.2775, 1.0], atol=1e-4)


def test_wilson_by_hand_for_one_of_two():
    z = 1.959963984540054
    half = z / (1 + z**2 / 2) * np.sqrt(0.25 / 2 + z**2 / 16)
    low, high = wilson_interval(1, 2)
    np.testing.assert_allclose([low, high], [0.5 - half, 0.5 + half], rtol=1e-12)


def test_wilson_without_trials_knows_nothing():
    assert wilson_interval(0, 0) == (0.0, 1.0)


def test_a_rate_of_trainings_by_hand():
    over = rate_interval([45, 48, 30], [50, 50, 50])  # 90, 96 and 60 %
    assert (float(over.mean), over.n) == (pytest.approx(0.82), 3)
    half = 4.30265273 * np.std([0.9, 0.96, 0.6], ddof=1) / np.sqrt(3)  # Student's quantile of two degrees of freedom
    assert (float(over.low), float(over.high)) == (pytest.approx(0.82 - half), 1.0)
    one = rate_interval([8, 0], [10, 0])  # the second was judged on nothing
    assert (float(one.low), one.n) == (pytest.approx(0.4902, abs=1e-4), 10)
    assert rate_interval([0], [0]).n == 0
    with pytest.raises(ShapeError, match="between 0 and trials"):
        rate_interval([3], [2])


def test_trainings_that_agree_are_no_proof():
    """Five policies that never succeed in 20 episodes had an interval of no width."""
    never, pooled = rate_interval([0] * 5, [20] * 5), wilson_interval(0, 100)
    assert (float(never.low), float(never.high)) == (0.0, float(pooled[1]))


@given(st.lists(st.tuples(st.integers(0, 50), st.integers(0, 50)), min_size=1, max_size=8))
def test_a_rate_of_trainings_holds_its_mean_and_what_the_episodes_leave_open(counts):
    successes = np.array([one for one, _ in counts])
    trials = np.array([sum(pair) for pair in counts])
    over = rate_interval(successes, trials)
    if not over.n:
        return
    assert 0.0 <= over.low <= over.mean <= over.high <= 1.0
    low, high = wilson_interval(successes.sum(), trials.sum())
    assert over.low <= low + 1e-12
    assert over.high >= high - 1e-12


def test_a_mean_of_trainings_counts_trainings_and_one_its_episodes():
    assert mean_interval([[1.0, 3.0], [5.0]]).n == 2
    assert float(mean_interval([[1.0, 3.0], [5.0]]).mean) == 3.5
    assert mean_interval([[1.0, 2.0, 3.0]]).n == 3


@given(st.integers(0, 200), st.integers(0, 200))
def test_wilson_holds_its_rate_and_mirrors(successes, failures):
    trials = successes + failures
    low, high = wilson_interval(successes, trials)
    mirror_low, mirror_high = wilson_interval(failures, trials)
    np.testing.assert_allclose([low, high], [1 - mirror_high, 1 - mirror_low], atol=1e-12)
    if trials:
        assert 0 <= low <= successes / trials <= high <= 1


def test_wilson_refuses_impossible_counts():
    with pytest.raises(ShapeError, match="between 0 and trials"):
        wilson_interval(3, 2)
    with pytest.raises(ShapeError, match="level"):
        wilson_interval(1, 2, level=95)


def test_t_interval_by_hand():
    # 1, 2, 3: mean 2, standard error 1 / sqrt(3), t quantile 4.302653 with 2 degrees of freedom
    interval = t_interval([[1.0, 2.0, 3.0], [5.0, 5.0, 5.0]])
    np.testing.assert_allclose(interval.mean, [2.0, 5.0])
    np.testing.assert_allclose(interval.high, [2 + 4.302652729911275 / np.sqrt(3), 5.0], rtol=1e-9)
    np.testing.assert_allclose(interval.low + interval.high, 2 * interval.mean)
    assert interval.n == 3


def test_one_sample_has_no_limits():
    interval = t_interval([4.0])
    assert interval.mean == 4.0
    assert np.isnan(interval.low)
    assert not interval.excludes_zero


@given(arrays(float, (3, 8), elements=finite), st.integers(0, 2**32 - 1))
def test_bootstrap_limits_stay_within_the_samples(values, seed):
    interval = bootstrap_interval(values, np.random.default_rng(seed), resamples=200)
    assert np.all(interval.low >= values.min(axis=1) - 1e-9)
    assert np.all(interval.high <= values.max(axis=1) + 1e-9)
    assert np.all(interval.low <= interval.high)


def test_bootstrap_covers_like_t_on_normal_samples():
    rng = np.random.default_rng(0)
    values = rng.normal(3.0, 1.0, (400, 40))
    interval = bootstrap_interval(values, rng)
    hit = np.mean((interval.low <= 3.0) & (interval.high >= 3.0))
    assert 0.90 < hit < 0.98
    student = t_interval(values)
    np.testing.assert_allclose(np.mean(interval.high - interval.low), np.mean(student.high - student.low), rtol=0.1)


def test_pairing_removes_what_both_share():
    rng = np.random.default_rng(0)
    shared = rng.normal(0.0, 100.0, 30)
    a, b = shared + 5.0 + rng.normal(0, 1, 30), shared
    for interval in (paired_difference(a, b), paired_difference(a, b, rng)):
        assert interval.excludes_zero
        assert interval.mean == pytest.approx(5.0, abs=1.0)
        assert interval.high - interval.low < 2.0


def test_paired_difference_turns_its_sign():
    rng = np.random.default_rng(1)
    a, b = rng.normal(size=(2, 12))
    one, other = paired_difference(a, b), paired_difference(b, a)
    np.testing.assert_allclose([one.mean, one.low, one.high], [-other.mean, -other.high, -other.low])


def test_bad_samples_are_refused():
    with pytest.raises(ShapeError, match="shapes"):
        paired_difference([1.0, 2.0], [1.0])
    with pytest.raises(ShapeError, match="NaN"):
        t_interval([1.0, np.nan])
    with pytest.raises(ShapeError, match="at least one"):
        t_interval([])


def test_resample_weights_count_draws_with_replacement():
    weights = resample_weights(5, 1000, np.random.default_rng(0))
    assert weights.shape == (1000, 5)
    assert np.all(weights.sum(axis=1) == 5)
    assert np.mean(weights == 0) == pytest.approx(0.8**5, abs=0.03)
