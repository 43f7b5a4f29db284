"""Theorem 3.4.1 as the thesis proves it, with all its 2n + 1 facilities, against `of_problem`, which folds it."""

import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from p2l.team import Decision, objective, plan, solve_facility_location
from p2l.team.facility import of_problem, solve_pairs
from p2l.team.outcome import decide
from tests.team.team_instances import facility_cost, problems, thesis_set


def instance_of_the_proof(problem):
    """Opening costs [2n + 1] and service costs [n, 2n + 1]: n delegate facilities, n learn facilities, the pre-trained.

    The last one is not in the thesis; without it an untaught, undelegated task could only be served at the big M.
    """
    n = problem.n
    big = 1.0 + (problem.c_rob + problem.c_fail + problem.c_hum).max()
    service = np.full((n, 2 * n + 1), big)
    for task in range(n):
        service[task, task] = 0.0
        for lesson in range(n):
            if problem.order == "any" or lesson < task:
                service[task, n + lesson] = (
                    problem.c_rob[task] + (1.0 - problem.transfer[lesson, task]) * problem.c_fail[task]
                )
        service[task, n + task] = 0.0  # a demonstration completes its own task
        service[task, 2 * n] = problem.c_rob[task] + (1.0 - problem.pretrained[task]) * problem.c_fail[task]
    return np.concatenate([problem.c_hum, problem.c_demo, [0.0]]), service


def decisions_of(open_set):
    """[n] the plan behind open facilities [2n + 1]; a delegate facility beside its own lesson adds nothing."""
    n = len(open_set) // 2
    return np.where(open_set[n:-1], Decision.LEARN, np.where(open_set[:n], Decision.DELEGATE, Decision.ACT))


def open_set_of(decision):
    """[2n + 1] the open facilities behind a plan; they cost what the plan is expected to cost."""
    return np.concatenate([decision == Decision.DELEGATE, decision == Decision.LEARN, [True]])


@settings(max_examples=200)
@given(problems())
def test_the_instance_that_is_solved_is_the_proofs_with_its_own_choices_folded(problem):
    n = problem.n
    opening, service = instance_of_the_proof(problem)
    pairs = of_problem(problem)
    # what a task costs without lessons: its own delegate facility, or the pre-trained one
    outside = np.minimum(opening[:n] + service[np.arange(n), np.arange(n)], service[:, -1])
    np.testing.assert_array_equal(pairs.outside, outside)
    np.testing.assert_array_equal(pairs.opening, opening[n:-1])
    table = np.full((n, n), np.inf)
    table[pairs.rows(), pairs.facility] = pairs.cost
    lessons = service[:, n:-1]
    np.testing.assert_array_equal(table, np.where(lessons < outside[:, None], lessons, np.inf))


@settings(max_examples=100)
@given(problems())
def test_the_two_problems_have_one_optimum_and_its_solution_is_a_plan(problem):
    best = plan(problem, "exhaustive").objective
    solution = solve_facility_location(*instance_of_the_proof(problem))
    assert np.isclose(solution.cost, best, rtol=1e-8, atol=1e-6)
    assert objective(problem, decisions_of(solution.open)).total <= solution.cost + 1e-6
    lessons = solve_pairs(of_problem(problem), deadline=time.perf_counter() + 30.0).open
    assert objective(problem, decide(problem, lessons)).total == pytest.approx(best, rel=1e-8, abs=1e-6)


@settings(max_examples=200)
@given(problems(), st.data())
def test_every_plan_is_an_open_set_of_the_same_cost(problem, data):
    kinds = st.lists(st.sampled_from(list(Decision)), min_size=problem.n, max_size=problem.n)
    decision = np.array(data.draw(kinds), dtype=np.int64)
    open_set = open_set_of(decision)
    assert np.array_equal(decisions_of(open_set), decision)
    assert np.isclose(facility_cost(*instance_of_the_proof(problem), open_set), objective(problem, decision).total)


def test_the_size_of_the_instance():
    opening, service = instance_of_the_proof(thesis_set(5))
    assert (opening.shape, service.shape) == ((11,), (5, 11))
    pairs = of_problem(thesis_set(5))
    assert (pairs.facilities, pairs.demands, len(pairs.cost)) == (5, 5, 5)  # each lesson serves its own task only
