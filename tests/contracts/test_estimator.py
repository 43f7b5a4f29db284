import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from p2l.contracts.estimator import DRAWS, Estimator
from p2l.errors import ConfigError

SIGMA = (0.02, 0.01)


def noise(n=3):
    return Estimator("fixed", SIGMA).draw(np.random.default_rng(0), n)


def test_hand_computed():
    unit = np.zeros((2, DRAWS, 2))
    unit[:, 0], unit[:, 1], unit[:, 3] = [1.0, -2.0], [3.0, 0.0], [8.0, 8.0]
    actions = np.array([0, 3])
    np.testing.assert_allclose(Estimator("exact", SIGMA).error(unit, actions), 0.0)
    np.testing.assert_allclose(Estimator("fixed", SIGMA).error(unit, actions), [[0.02, -0.02], [0.02, -0.02]])
    np.testing.assert_allclose(Estimator("halving", SIGMA).error(unit, actions), [[0.02, -0.02], [0.02, 0.01]])
    np.testing.assert_allclose(Estimator("after_first", SIGMA).error(unit, actions), [[0.02, -0.02], [0.0, 0.0]])


def test_no_error_is_smaller_than_the_least_one_by_hand():
    """σ of 20 and 10 mm, halved three times; none falls below 5 mm, and one of 4 mm does not rise to 8."""
    unit, actions = np.ones((1, DRAWS, 2)), np.array([3])
    np.testing.assert_allclose(Estimator("halving", SIGMA, 0.005).error(unit, actions), [[0.005, 0.005]])
    np.testing.assert_allclose(Estimator("halving", (0.02, 0.004), 0.008).error(unit, actions), [[0.008, 0.004]])
    np.testing.assert_allclose(Estimator("fixed", SIGMA, 0.005).error(unit, actions), [[0.02, 0.01]])
    with pytest.raises(ConfigError, match="least standard deviation"):
        Estimator("halving", SIGMA, -0.1)


@given(st.integers(0, 40))
def test_halving_never_exceeds_its_bound_and_is_a_function_of_the_row(actions):
    unit = noise()
    count = np.full(3, actions)
    error = Estimator("halving", SIGMA).error(unit, count)
    assert (np.abs(error) <= np.abs(unit).max() * np.array(SIGMA) * 0.5**actions).all()
    alone = Estimator("halving", SIGMA).error(unit[1:2], count[1:2])
    np.testing.assert_array_equal(alone[0], error[1])


@pytest.mark.parametrize("sigma", [(-0.1,), (np.nan,), (np.inf,)])
def test_bad_deviations_are_refused(sigma):
    with pytest.raises(ConfigError, match="sigma_m"):
        Estimator("fixed", sigma)


def test_unknown_mode_lists_the_known():
    with pytest.raises(ConfigError, match="unknown estimator 'perfect'; known: exact, fixed, halving, after_first"):
        Estimator("perfect", SIGMA)
