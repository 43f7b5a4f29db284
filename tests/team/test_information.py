"""The worth of trials against brute force: every plan, every outcome, on instances small enough for that."""

import itertools
import math
import warnings
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from p2l.team.information import Stake, TrialValue, cost_of, outlook, screened, trial_values, value_of_trial
from p2l.team.planners import plan
from p2l.team.problem import Problem
from p2l.transfer.beliefs import BetaBelief, LatentBelief

EVERYTHING = 10_000


def stake_of(rng, n, order="fixed", copies=False, belief=None):
    """A small day with random costs, and a belief about n tasks."""
    costs = {name: rng.uniform(*span, n) for name, span in COSTS.items()}
    problem = Problem(
        tuple("abcdef"[:n]), **costs, pretrained=rng.uniform(0.0, 0.4, n), transfer=np.ones((n, n)), order=order
    )
    place = rng.integers(0, n - 1, n) if copies else rng.permutation(n)
    return Stake(problem, place, belief or BetaBelief(*rng.uniform(0.3, 3.0, (2, n * n))), n)


COSTS = {"c_rob": (1.0, 5.0), "c_hum": (8.0, 20.0), "c_fail": (5.0, 30.0), "c_demo": (10.0, 30.0)}


def cheapest(problem, p):
    """The cost of the best plan by trying every set of lessons; p [n, n]."""
    n, best = problem.n, math.inf
    for lessons in itertools.product((False, True), repeat=n):
        total = 0.0
        for j in range(n):
            usable = [i for i in range(n) if lessons[i] and i != j and (problem.order == "any" or i < j)]
            chance = max([problem.pretrained[j], *(p[i, j] for i in usable)])
            attempt = problem.c_rob[j] + (1.0 - chance) * problem.c_fail[j]
            total += problem.c_demo[j] if lessons[j] else min(problem.c_hum[j], attempt)
        best = min(best, total)
    return best


def brute_force(stake, pair, attempts):
    """What is saved in expectation: the best cost now, less the mean of the best costs after each outcome."""
    a, b = stake.belief.successes, stake.belief.failures
    mean = a / (a + b)
    after = 0.0
    for wins in range(attempts + 1):
        share = math.comb(attempts, wins)
        for k in range(wins):
            share *= a[pair] + k
        for k in range(attempts - wins):
            share *= b[pair] + k
        for k in range(attempts):
            share /= a[pair] + b[pair] + k
        updated = mean.copy()
        updated[pair] = (a[pair] + wins) / (a[pair] + b[pair] + attempts)
        after += share * cheapest(stake.problem, updated[stake.index])
    return cheapest(stake.problem, mean[stake.index]) - after


@pytest.mark.parametrize(("order", "copies"), [("fixed", False), ("any", False), ("fixed", True)])
def test_the_worth_of_every_trial_is_that_of_brute_force(order, copies):
    worth = 0
    for seed in range(6):
        stake = stake_of(np.random.default_rng(seed), 4, order, copies)
        today = plan(stake.today)
        for pair, attempts in itertools.product(range(16), (1, 3)):
            value = value_of_trial(stake, today, pair, attempts)
            assert value == pytest.approx(brute_force(stake, pair, attempts), abs=1e-9 * max(1.0, today.objective))
            worth += value > 0.0
    assert worth > 10


@pytest.mark.parametrize(("order", "copies"), [("fixed", False), ("any", False), ("any", True)])
def test_screening_leaves_out_no_pair_of_worth(order, copies):
    """With independent beliefs, and an exact value for all that is let through."""
    found = 0
    for seed in range(10):
        stake = stake_of(np.random.default_rng(100 + seed), 4, order, copies)
        today = plan(stake.today)
        exact = {pair: brute_force(stake, pair, 1) for pair in range(16)}
        valuable = {pair for pair, value in exact.items() if value > 1e-6 * today.objective}
        assert valuable <= set(screened(stake, today).tolist())
        values = trial_values(stake, today, largest=EVERYTHING, attempts=(1,))
        assert {each.taught * 4 + each.tested for each in values} >= valuable
        assert [each.value(1) for each in values] == sorted((each.value(1) for each in values), reverse=True)
        found += len(valuable)
    assert found > 8


def correlated(rng, size, spread):
    """Jointly normal logits."""
    factor = spread * rng.normal(size=(size, size)) / np.sqrt(size)
    covariance = factor @ factor.T + 1e-9 * np.eye(size)
    return LatentBelief(rng.normal(-0.5, 1.5, size), np.diag(covariance).copy(), lambda pair: covariance[pair])


@settings(max_examples=8)
@given(st.integers(0, 10_000), st.sampled_from(["fixed", "any"]))
def test_no_trial_is_worth_less_than_nothing_and_more_attempts_are_worth_no_less(seed, order):
    rng = np.random.default_rng(seed)
    stake = stake_of(rng, 4, order, belief=correlated(rng, 16, 1.5))
    today = plan(stake.today)
    for pair in rng.choice(16, 4, replace=False).tolist():
        values = [value_of_trial(stake, today, pair, attempts) for attempts in (1, 2, 5)]
        assert values[0] >= 0.0
        assert np.diff(values).min() > -2e-3 * today.objective  # up to quadrature


def test_a_trial_that_cannot_change_the_plan_is_worth_exactly_nothing():
    rng = np.random.default_rng(0)
    stake = stake_of(rng, 4, belief=correlated(rng, 16, 1e-4))
    day = outlook(stake, EVERYTHING)
    assert day.values == ()
    assert value_of_trial(stake, day.plan, 1, 5) == 0.0


def test_a_trial_of_one_pair_can_be_worth_something_through_another():
    """The pair that is tried plays no part in the day; the one that it resembles decides whether a lesson pays."""
    three = np.ones(3)
    problem = Problem(("a", "b", "c"), 1 * three, 10 * three, 20 * three, 12 * three, 0 * three, np.ones((3, 3)))
    logit, covariance = np.full(9, -6.0), 1e-6 * np.eye(9)
    logit[[1, 2, 5]] = 1.0, 1.0, -6.0
    alike = np.ix_([1, 2, 6], [1, 2, 6])  # a on b, a on c; and c on a, which comes too late to be of use
    covariance[alike] = 2.0 * (0.999 + 0.001 * np.eye(3))
    logit[6] = 1.0
    belief = LatentBelief(logit, np.diag(covariance).copy(), lambda pair: covariance[pair])
    stake = Stake(problem, np.arange(3), belief, 3)
    today = plan(stake.today)
    assert value_of_trial(stake, today, 6, 3) > 0.1
    assert value_of_trial(stake, today, 7, 3) == 0.0


def test_today_s_plan_keeps_its_lessons_and_skills():
    rng = np.random.default_rng(4)
    stake = stake_of(rng, 5)
    today = plan(stake.today)
    assert cost_of(stake.today, today) == pytest.approx(today.objective, rel=1e-12)
    hopeless = stake.expected(np.zeros(25))
    acts = (today.decision == 0) & (today.skill >= 0)
    expected = today.objective + (stake.today.c_fail * today.p_success)[acts].sum()
    assert cost_of(hopeless, today) == pytest.approx(expected)


def test_a_task_that_cannot_be_taught_and_a_lesson_that_may_not_have_taught_are_no_matter_of_chance():
    """Infinite costs leave no warning (infinity less infinity), and a factor of p is in every step of the valuing."""
    rng = np.random.default_rng(2)
    stake = stake_of(rng, 5)
    c_demo = np.where(np.arange(5) == 1, np.inf, stake.problem.c_demo)
    learnt = np.repeat(np.array([0.9, 1.0, 0.5, 1.0, 0.8])[:, None], 5, axis=1)
    stake = replace(stake, problem=replace(stake.problem, c_demo=c_demo, transfer=learnt))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        day = outlook(stake, EVERYTHING)
    mean = stake.belief.successes / (stake.belief.successes + stake.belief.failures)
    assert_allclose(stake.today.transfer, learnt * mean[stake.index])
    assert day.plan.objective == pytest.approx(cheapest(stake.problem, learnt * mean[stake.index]))
    assert day.values


def test_the_best_number_of_attempts_saves_most_each():
    assert TrialValue(0, 1, 0.5, (0.0, 1.0, 3.3, 4.0)).best == 3
    assert TrialValue(0, 1, 0.5, (2.0, 3.0)).best == 1
