import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from p2l.team import Decision, objective, plan
from p2l.team.outcome import decide
from p2l.team.pruning import without_losses
from tests.team.team_instances import geometric, problems, thesis_set


def total(problem, taught):
    return objective(problem, decide(problem, taught)).total


def test_by_hand_the_lesson_that_loses_most_goes_first_and_the_one_that_pays_stays():
    transfer = np.zeros((5, 5))
    transfer[0, 2:] = 0.9  # saves 80 on each of three tasks, costs 100 more than the person
    transfer[1, 2:] = 0.8  # saves nothing beside the first, and alone less than it
    taught = np.array([True, True, False, False, True])
    assert without_losses(thesis_set(5, transfer), taught).tolist() == [True, False, False, False, False]


@settings(max_examples=150)
@given(problems(), st.data())
def test_no_lesson_is_left_whose_removal_saves_and_none_was_dropped_that_paid(problem, data):
    taught = np.array(data.draw(st.lists(st.booleans(), min_size=problem.n, max_size=problem.n)))
    rest = without_losses(problem, taught)
    cost = total(problem, rest)
    slack = 1e-9 * max(1.0, cost)
    assert not (rest & ~taught).any()
    assert cost <= total(problem, taught) + slack
    for lesson in np.flatnonzero(rest):
        fewer = rest.copy()
        fewer[lesson] = False
        assert total(problem, fewer) >= cost - slack


@pytest.mark.parametrize("planner", ["highs", "facility", "auto"])
def test_every_lesson_of_a_plan_stopped_at_once_pays(planner):
    problem = geometric(400)
    result = plan(problem, planner, time_limit_s=1e-3)
    lessons = result.decision == Decision.LEARN
    assert result.lower_bound <= result.objective
    for lesson in np.flatnonzero(lessons):
        fewer = lessons.copy()
        fewer[lesson] = False
        assert total(problem, fewer) >= result.objective - 1e-6
