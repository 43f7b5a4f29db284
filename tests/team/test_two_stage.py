"""Plans for an uncertain tomorrow against every plan there is, laws, and cases computed by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from two_stage_instances import large_program, of_shop, one_scenario, small_program

from benchmarks.instances import large_shop
from p2l.errors import ConfigError, ShapeError, SolverError
from p2l.team import Problem
from p2l.team.shop import Shop, plan_shop
from p2l.team.tomorrow import (
    check_two_stage_plan,
    hindsight,
    mean_tomorrow,
    plan_for_mean,
    plan_myopically,
    plan_two_stage,
    realised,
    recourse,
    two_stage_bound,
    two_stage_outcome,
    with_counts,
)
from p2l.team.tomorrow.oracle import every_two_stage_plan
from p2l.team.tomorrow.reasons import explain_two_stage, lesson_times
from p2l.team.tomorrow.sampling import Estimate, GapInterval


@pytest.mark.parametrize(
    ("order", "commit"), [("fixed", "today"), ("any", "today"), ("partial", "today"), ("any", "all"), ("fixed", "all")]
)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=50, deadline=None)
def test_no_plan_of_a_small_tomorrow_is_better(order, commit, seed):
    program = small_program(np.random.default_rng(seed), order, commit)
    try:
        best = every_two_stage_plan(program)[0]
    except SolverError:
        with pytest.raises(ConfigError, match="no plan keeps today's limits"):
            plan_two_stage(program)
        return
    day = plan_two_stage(program)
    verdict = check_two_stage_plan(program, day)
    assert day.status == "optimal"
    assert_allclose([day.objective, verdict.bound], best, rtol=2e-9, atol=1e-9)
    _, tomorrow = recourse(program, day.taught)
    assert_allclose(day.today.objective + program.probability @ tomorrow, best, rtol=2e-9, atol=1e-9)


@pytest.mark.parametrize("seed", [745, 1170, 7718, 15801, 1573489442])
def test_a_limit_is_proven_where_no_price_closes_its_gap(seed):
    """The search decided about lessons that serve nothing, and called decided what the check could not."""
    program = small_program(np.random.default_rng(seed), "partial", "today")
    day = plan_two_stage(program)
    assert np.isfinite(program.today.max_teaching)
    assert day.status == "optimal"
    assert_allclose(check_two_stage_plan(program, day).bound, every_two_stage_plan(program)[0], rtol=2e-9)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_knowing_more_never_costs_more(seed):
    """Hindsight ≤ the plan for the scenarios ≤ plans for their mean and for today alone; waiting is never dearer."""
    program = large_program(int(seed % 6) + 3, int(seed % 5) + 2, seed=seed, c_demo=float(100 + seed % 200))
    day = plan_two_stage(program)
    best = day.objective * (1 - 1e-8)
    assert program.probability @ hindsight(program) <= day.objective * (1 + 1e-8)
    assert best <= program.probability @ realised(program, plan_for_mean(program))
    assert best <= program.probability @ realised(program, plan_myopically(program))
    assert best <= plan_two_stage(replace(program, commit="all")).objective
    assert_allclose(program.probability @ realised(program, day.today), day.objective, rtol=1e-8)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_without_lessons_tomorrow_the_mean_is_enough(seed):
    program = large_program(8, 5, seed=seed, commit="all", order="fixed")
    mean = mean_tomorrow(program)
    assert len(program.groups.kind) == len(mean.groups.kind) <= 8
    assert_allclose(plan_two_stage(program).objective, plan_two_stage(mean).objective, rtol=2e-9)
    assert plan_for_mean(program).taught.tolist() == plan_two_stage(program).taught.tolist()


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_scenarios_that_are_alike_are_one(seed):
    rng = np.random.default_rng(seed)
    program = large_program(5, 4, seed=seed, mean=0.3)
    twice = replace(program, counts=np.tile(program.counts, (2, 1)), probability=np.tile(program.probability, 2) / 2)
    merged = with_counts(twice, twice.counts, twice.probability)
    assert merged.scenarios <= program.scenarios
    objectives = [plan_two_stage(each).objective for each in (program, twice, merged)]
    assert_allclose(objectives, objectives[0], rtol=2e-9)
    order = rng.permutation(program.scenarios)
    shuffled = replace(program, counts=program.counts[order], probability=program.probability[order])
    assert_allclose(plan_two_stage(shuffled).objective, objectives[0], rtol=2e-9)


def test_nothing_tomorrow_is_today_alone():
    shop = large_shop(12, 2, order="any")
    program = of_shop(shop, np.zeros((1, shop.n)))
    day, alone = plan_two_stage(program), plan_shop(shop)
    assert day.objective == pytest.approx(alone.objective, rel=2e-9)
    assert day.tomorrow.tolist() == [0.0]
    assert check_two_stage_plan(program, day).optimal


def gears(counts, probability):
    """One gear today; a lesson lets the robot do another with 0.9: an attempt is then 10 + 0.1 · 100 = 20."""
    one = np.ones(1)
    problem = Problem(("gear",), 10 * one, 100 * one, 100 * one, 150 * one, 0 * one, np.full((1, 1), 0.9))
    return of_shop(Shop.of_problem(problem), np.array(counts), probability=np.array(probability))


@pytest.mark.parametrize(
    ("chance", "taught", "objective"),
    [
        # today: 150 + q · 9 · 20; waiting: 100 + q · (150 + 8 · 20)
        (0.4, 1, 150 + 0.4 * 180),
        (0.3, 0, 100 + 0.3 * 310),
    ],
)
def test_a_lesson_waits_where_orders_are_improbable(chance, taught, objective):
    program = gears([[9], [0]], [chance, 1 - chance])
    day = plan_two_stage(program)
    assert len(day.taught) == taught
    assert day.objective == pytest.approx(objective)
    assert list(day.shares(program)) == ([] if taught else [(0, 0, pytest.approx(chance))])
    assert check_two_stage_plan(program, day).optimal


def test_a_limit_is_on_today():
    """Without one, ten gears for sure make today's lesson pay; with none allowed it is given tomorrow instead."""
    program = gears([[10]], [1.0])
    limited = replace(program, today=replace(program.today, max_lessons=0))
    assert plan_two_stage(program).objective == pytest.approx(150 + 200)
    day = plan_two_stage(limited)
    assert (len(day.taught), day.objective) == (0, pytest.approx(100 + 150 + 9 * 20))
    assert check_two_stage_plan(limited, day).optimal


def test_what_is_not_so_is_refused():
    program = large_program(10, 8, c_demo=150.0)
    day = plan_two_stage(program)
    wrong = [
        (replace(day, objective=day.objective * 0.99), "objective"),
        (replace(day, lower_bound=day.objective * 1.01), "lower_bound"),
        (replace(day, tomorrow=day.tomorrow * 0.9), "cost of a scenario"),
        (replace(day, certificate=None), "none given"),
        (replace(day, today=replace(day.today, expected_cost=day.today.expected_cost * 0.5)), "expected_cost"),
        (replace(day, status="feasible"), "status"),
    ]
    for plan, words in wrong:
        with pytest.raises(SolverError, match=words):
            check_two_stage_plan(program, plan)
    with pytest.raises(SolverError, match="no proof of this shop"):
        two_stage_bound(one_scenario(program, 0), day.certificate)
    with pytest.raises(ShapeError, match="commit=all"):
        two_stage_outcome(replace(program, commit="all"), day.taught, day.today.sequence, [[0, 0, 0]])


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"probability": [0.5, 0.6]}, "sum to 1.1; expected 1"),
        ({"probability": [0.0, 1.0]}, "leave it out"),
        ({"counts": [[-1], [0]]}, "at least 0"),
        ({"lesson": [1]}, "at most 0"),
        ({"commit": "none"}, "'none' is unknown"),
        ({"c_hum": [np.nan]}, "NaN"),
    ],
)
def test_a_wrong_tomorrow_is_refused(changes, words):
    program = gears([[9], [0]], [0.4, 0.6])
    with pytest.raises(ShapeError, match=words):
        replace(program, **changes)


def test_a_deadline_leaves_a_plan_with_its_true_bound():
    program = large_program(40, 60)
    day = plan_two_stage(program, time_limit_s=0.5)
    verdict = check_two_stage_plan(program, day)
    assert day.lower_bound <= verdict.bound * (1 + 1e-9) <= day.objective * (1 + 2e-9)


def test_fewer_samples_than_were_asked_for_are_told():
    program = gears([[4], [0]], [0.5, 0.5])
    plan = plan_two_stage(program)
    reasons = lesson_times(program, plan)
    found = Estimate(1.0, 0.5, 1.5, GapInterval(0.0, 0.1, 0.95, 2), fresh=True)
    assert "There was time for 2 of 10 samples" in explain_two_stage(program, plan, reasons, found, 10)
    assert "There was time" not in explain_two_stage(program, plan, reasons, found, 2)
    assert "There was time" not in explain_two_stage(program, plan, reasons, replace(found, fresh=False), 10)
