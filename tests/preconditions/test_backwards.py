"""Preconditions of states as the robot sees them, on the small push world whose block is seen with an error across."""

import numpy as np
import pytest

from p2l.errors import ConfigError
from p2l.preconditions.backwards import ChainingOptions, chain_preconditions
from p2l.preconditions.vicinity import Vicinity
from tests.metareskill import pushing_back as pb

BUDGET = {"trajectories": 24, "samples": 48, "timing": pb.TIMING, "vicinity": Vicinity()}


@pytest.fixture(scope="module")
def chained():
    world, task, nominal = pb.setting(estimator="fixed", sigma_m=0.03)
    given = world, task.symbols, nominal
    return [
        chain_preconditions(*given, ChainingOptions(**BUDGET, error=error, draws=5), seed=0) for error in (0.0, 1.0)
    ]


def test_states_are_seen_several_times_and_labels_are_of_the_truth(chained):
    true, seen = chained
    for one, other in zip(true.samples[-1:], seen.samples[-1:], strict=True):  # the same executions, seen otherwise
        assert len(other.states) == 5 * len(one.states)
        np.testing.assert_array_equal(other.labels, np.repeat(one.labels, 5))
        np.testing.assert_array_equal(other.held_out, np.repeat(one.held_out, 5))
        away = other.states - np.repeat(one.states, 5, axis=0)
        np.testing.assert_array_equal(away[:, 0], 0.0)  # how far the hand is along the way is known
        assert away[:, 1].std() == pytest.approx(0.03, rel=0.15)
        assert abs(away[:, 1].mean()) < 0.01


def test_good_starts_and_the_goal_stay_what_they_are(chained):
    true, seen = chained
    np.testing.assert_array_equal(true.preconditions.goal.means, seen.preconditions.goal.means)
    assert [len(good) for good in seen.good] == [5 * len(good) for good in true.good]


def test_a_robot_that_sees_badly_calls_fewer_good_states_lost(chained):
    """The last skill's good starts, seen with the error: how often does its precondition hold?"""
    true, seen = (each.preconditions.skills[-1] for each in chained)
    looked_at = chained[1].good[-1]
    assert seen.holds(looked_at).mean() > true.holds(looked_at).mean() + 0.1


@pytest.mark.parametrize("wrong", [{"error": -1.0}, {"error": np.inf}, {"draws": 0}])
def test_an_impossible_error_is_refused(wrong):
    with pytest.raises(ConfigError, match="error"):
        ChainingOptions(trajectories=24, samples=48, **wrong)
