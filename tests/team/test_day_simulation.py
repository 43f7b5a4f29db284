"""Days of a study by hand: one lesson, two tasks that it may serve, and what each way makes of what it sees."""

import numpy as np
import pytest

from p2l.team import Problem
from p2l.team.day import SkillPrior
from p2l.team.day.simulation import WAYS, Truths, simulate, truths_of
from p2l.team.shop import Shop, plan_shop


def problem(predicted, c_hum):
    """Lessons cost 150, an attempt 10, a failed one 100 more."""
    cost = {"c_rob": 10.0, "c_hum": c_hum, "c_fail": 100.0, "c_demo": 150.0}
    return Problem(
        tuple("abc"), **{name: np.full(3, value) for name, value in cost.items()}, pretrained=np.zeros(3),
        transfer=predicted,
    )  # fmt: skip


def row(*successes):
    """[3, 3] transfer of the lesson on a; the others are of no use."""
    return np.array([[1.0, *successes], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])


def costs(predicted, true, uniforms, setting=None, c_hum=80.0, draws=1000):
    shop = Shop.of_problem(problem(predicted, c_hum))
    truths = Truths(true, true, np.zeros(3), draws)
    plan, prior = plan_shop(shop), setting or SkillPrior(prior_n=1e-3, spread=0.0)
    return {way: [each.cost for each in simulate(shop, plan, truths, uniforms, way, prior)] for way in WAYS}


@pytest.mark.parametrize("true", [row(1, 1), row(1, 0), row(0, 0)])
def test_what_is_known_for_certain_costs_the_same_in_all_ways(true):
    found = costs(true, true, np.full((2, 3), 0.5))
    assert len({cost for way in WAYS for cost in found[way]}) == 1


def test_a_lesson_that_fails_is_found_out_by_one_failure_or_before():
    """Predicted 150 + 20 + 20. In truth the lesson is of no use: 110 each if kept; tried, both are handed over."""
    found = costs(row(0.9, 0.9), row(0, 0), np.full((2, 3), 0.5), SkillPrior(prior_n=1.0, spread=10.0))
    assert found["once"] == [150.0 + 110.0 + 110.0] * 2
    assert found["outcomes"] == [150.0 + 110.0 + 80.0] * 2
    assert found["simulated"] == pytest.approx([150.0 + 80.0 + 80.0] * 2)
    assert found["ahead"] == found["simulated"]


def test_a_plan_that_knows_of_the_trial_gives_a_lesson_that_one_that_does_not_would_not():
    """Expected 150 + 2 · 80 = 310 if failures are paid for, 150 + 2 · 73 = 296 if seen first; without it 300."""
    found = costs(row(0.3, 0.3), row(1, 0), np.full((1, 3), 0.5), c_hum=100.0)
    assert found["once"] == [300.0] == found["simulated"]
    assert found["ahead"] == [150.0 + 10.0 + 100.0]


def test_a_draw_decides_what_is_seen_and_adds_no_noise():
    """An attempt that works half of the time costs 60 whether it is lucky or not."""
    found = costs(row(0.9, 0.9), row(0.5, 0.5), np.array([[0.0, 0.4, 0.4], [0.0, 0.6, 0.6]]), SkillPrior(1.0, 10.0))
    assert found["once"] == [270.0, 270.0]
    assert found["outcomes"] == [270.0, 150.0 + 60.0 + 80.0]


def test_truths_of_a_set_are_those_of_its_tasks_and_skills():
    rates = np.arange(12.0).reshape(4, 3) / 12.0
    truths = truths_of(rates, rates / 2, np.array([2, 0]), np.array([3, -1]), 7)
    assert truths.planning.tolist() == (np.array([[8, 6], [2, 0]]) / 12.0).tolist()
    assert truths.executing.tolist() == (truths.planning / 2).tolist()
    assert truths.pretrained.tolist() == [11.0 / 24.0, 0.0]
