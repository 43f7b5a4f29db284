import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from p2l.team import Decision, objective, plan, solve_facility_location
from p2l.team.facility.reduction import facility_cost, to_decisions, to_facility_location, to_open
from tests.team.team_instances import problems, thesis_set


@settings(max_examples=100)
@given(problems())
def test_the_two_problems_have_one_optimum_and_its_solution_is_a_plan(problem):
    instance = to_facility_location(problem)
    best = plan(problem, "exhaustive").objective
    solution = solve_facility_location(instance.opening_cost, instance.service_cost)
    assert np.isclose(solution.cost, best, rtol=1e-8, atol=1e-6)
    decisions = to_decisions(problem, solution.open)
    assert objective(problem, decisions).total <= solution.cost + 1e-6


@settings(max_examples=200)
@given(problems(), st.data())
def test_every_plan_is_an_open_set_of_the_same_cost(problem, data):
    kinds = st.lists(st.sampled_from(list(Decision)), min_size=problem.n, max_size=problem.n)
    decision = np.array(data.draw(kinds), dtype=np.int64)
    instance = to_facility_location(problem)
    opened = to_open(decision)
    assert np.array_equal(to_decisions(problem, opened), decision)
    by_facilities = facility_cost(instance.opening_cost, instance.service_cost, opened)
    assert np.isclose(by_facilities, objective(problem, decision).total)


def test_the_size_of_the_instance():
    instance = to_facility_location(thesis_set(5))
    assert instance.opening_cost.shape == (11,)
    assert instance.service_cost.shape == (5, 11)
    assert instance.opening_cost[-1] == 0.0
