import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from p2l.metareskill.improvement import improvement, quantile
from tests.metareskill.skill_graphs import fresh, written

SETTINGS = {"window": 3, "confidence": 0.95}
rates = st.lists(st.floats(0.0, 1.0), max_size=8)


def limits(measured, **settings):
    history = written(fresh(2), [((0, 1), q) for q in measured])
    found = improvement(history, **{**SETTINGS, **settings})
    return found.mean[0, 1], found.upper[0, 1], found.q_upper[0, 1]


def test_the_quantile_is_that_of_a_two_sided_interval():
    for confidence in (0.5, 0.9, 0.95, 0.99):
        for count in (2, 3, 10):
            low, high = stats.t.interval(confidence, df=count - 1)
            assert quantile(confidence, np.array(count)) == pytest.approx(high)
            assert low == pytest.approx(-high)
    assert quantile(0.95, np.array(3)) == pytest.approx(4.302653, abs=1e-6)  # printed in any table


def test_a_small_history_by_hand():
    """Rates 0 → 0.10, 0.16, 0.20: differences 0.10, 0.06, 0.04; mean 0.2/3, s = 0.030551, t = 4.302653."""
    mean, upper, q_upper = limits([0.10, 0.16, 0.20])
    assert mean == pytest.approx(0.2 / 3)
    assert upper == pytest.approx(0.2 / 3 + 4.302653 * 0.0305505 / np.sqrt(3), abs=1e-6)
    assert q_upper == pytest.approx(0.20 + upper)


@given(rates, st.integers(2, 5), st.floats(0.05, 0.995))
def test_the_limit_is_the_upper_end_of_scipys_interval(measured, window, confidence):
    best = np.maximum.accumulate([0.0, *measured])
    differences = np.diff(best)[-window:]
    mean, upper, q_upper = limits(measured, window=window, confidence=confidence)
    if len(differences) < 2:
        assert (upper, q_upper) == (np.inf, 1.0)
        return
    error = stats.sem(differences)
    wanted = differences.mean() + (error and stats.t.interval(confidence, len(differences) - 1)[1] * error)
    assert mean == pytest.approx(differences.mean())
    assert upper == pytest.approx(wanted, abs=1e-9)
    assert q_upper == pytest.approx(min(1.0, best[-1] + wanted), abs=1e-9)
    assert best[-1] - 1e-12 <= q_upper <= 1.0


def test_only_the_window_counts():
    assert limits([0.5, 0.6, 0.65, 0.7]) == pytest.approx((0.2 / 3, *limits([0.5, 0.6, 0.65, 0.7])[1:]))
    assert limits([0.5, 0.6, 0.65, 0.7], window=4)[0] == pytest.approx(0.7 / 4)


def test_equal_differences_leave_no_doubt_and_no_division_by_zero():
    with np.errstate(all="raise"):
        assert limits([0.125, 0.25, 0.375]) == (0.125, 0.125, 0.5)
        assert limits([0.0, 0.0, 0.0]) == (0.0, 0.0, 0.0)
        assert limits([]) == (0.0, np.inf, 1.0)


def test_a_worse_measurement_does_not_lower_a_rate():
    assert limits([0.4, 0.1, 0.4])[2] == limits([0.4, 0.4, 0.4])[2]
    assert limits([0.4, 0.1])[0] == pytest.approx(0.2)


def test_doubt_is_what_no_success_in_n_trials_leaves_open():
    """1 − 0.05^(1/n), the limit of a rate of which n trials have shown none."""
    for n in (2, 3, 10):
        assert limits([0.0] * n, doubt=True)[2] == pytest.approx(1.0 - 0.05 ** (1.0 / n))
        assert stats.binom.cdf(0, n, limits([0.0] * n, doubt=True)[2]) == pytest.approx(0.05)
    assert limits([0.0], doubt=True) == limits([0.0])


@given(rates)
def test_doubt_says_nothing_of_what_has_risen(measured):
    if max([0.0, *measured]) > 0.0:
        assert limits(measured, doubt=True) == limits(measured)
