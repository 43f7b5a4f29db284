import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from p2l.artifacts import load_arrays, save_arrays
from p2l.errors import ConfigError, ShapeError
from p2l.metareskill.regression import ParameterisedSkill, fit_skill


def by_hand(skill, state):
    distance = np.linalg.norm((skill.states - state) / skill.scale, axis=1)
    nearest = np.argsort(distance, kind="stable")[: min(skill.neighbours, len(distance))]
    weight = 1.0 / distance[nearest]
    return weight @ skill.parameters[nearest] / weight.sum()


@settings(max_examples=25)
@given(st.integers(1, 8), st.integers(0, 2**32 - 1))
def test_it_is_the_distance_weighted_mean_of_the_nearest(count, seed):
    rng = np.random.default_rng(seed)
    skill = fit_skill(rng.normal(size=(count, 6)), rng.normal(size=(count, 21)))
    states = rng.normal(size=(4, 6))
    np.testing.assert_allclose(skill.predict(states), [by_hand(skill, state) for state in states], atol=1e-9)
    np.testing.assert_array_equal(skill.predict(skill.states), skill.parameters)  # whatever the processor


def test_two_neighbours_by_hand():
    """Distances 1 and 3: weights 3/4 and 1/4."""
    skill = fit_skill(np.array([[0.0], [4.0]]), np.array([[0.0, 8.0], [4.0, 0.0]]))
    np.testing.assert_allclose(skill.predict(np.array([[1.0]])), [[1.0, 6.0]])


def test_the_units_of_a_feature_do_not_matter():
    rng = np.random.default_rng(0)
    states, parameters, wanted = rng.normal(size=(6, 2)), rng.normal(size=(6, 3)), rng.normal(size=(5, 2))
    units = np.array([1000.0, 0.01])
    one, other = fit_skill(states, parameters), fit_skill(states * units, parameters)
    np.testing.assert_allclose(one.predict(wanted), other.predict(wanted * units))


def test_the_spread_may_come_from_all_failures_of_the_mode():
    rng = np.random.default_rng(1)
    mode = rng.normal(size=(50, 2)) * [1.0, 5.0]
    skill = fit_skill(mode[:2], np.eye(2), reference=mode)
    np.testing.assert_allclose(skill.scale, mode.std(axis=0))


def test_a_single_solved_failure_and_a_constant_feature_are_fine():
    skill = fit_skill(np.array([[1.0, 2.0]]), np.array([[3.0]]))
    np.testing.assert_allclose(skill.predict(np.array([[9.0, 9.0], [1.0, 2.0]])), 3.0)
    assert skill.predict(np.zeros((0, 2))).shape == (0, 1)


def test_it_survives_storage(tmp_path):
    rng = np.random.default_rng(2)
    skill = fit_skill(rng.normal(size=(5, 6)), rng.normal(size=(5, 21)), neighbours=2)
    save_arrays(tmp_path / "skill.npz", skill.arrays(), schema="recovery", version=1)
    back = ParameterisedSkill.from_arrays(load_arrays(tmp_path / "skill.npz", schema="recovery", version=1))
    states = rng.normal(size=(4, 6))
    np.testing.assert_array_equal(back.predict(states), skill.predict(states))


def test_bad_data_are_refused():
    with pytest.raises(ShapeError, match="solved none"):
        fit_skill(np.zeros((0, 2)), np.zeros((0, 3)))
    with pytest.raises(ShapeError, match="parameters: axis 0"):
        fit_skill(np.zeros((2, 2)), np.zeros((3, 3)))
    with pytest.raises(ShapeError, match="NaN"):
        fit_skill(np.zeros((1, 2)), np.zeros((1, 3))).predict(np.array([[np.nan, 0.0]]))
    with pytest.raises(ShapeError, match="states: axis 1"):
        fit_skill(np.zeros((1, 2)), np.zeros((1, 3))).predict(np.zeros((1, 3)))
    with pytest.raises(ConfigError, match="neighbours"):
        fit_skill(np.zeros((1, 2)), np.zeros((1, 3)), neighbours=0)
