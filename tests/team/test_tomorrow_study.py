"""The study of planning for tomorrow: its futures, what plans cost when executed, and its table."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose

from p2l.contracts.domain import Tasks
from p2l.evaluation.team.tomorrow_table import tomorrow_table
from p2l.team.execute import Truth
from p2l.team.study import Block, Regime, TaskSet
from p2l.team.tomorrow import plan_two_stage
from p2l.team.tomorrow.study import KINDS, METHODS, compare, executed_today, futures, two_days

REGIME = Regime("high_teaching", 10.0, 100.0, 100.0, 200.0, (0,))


def made_up(size, seed):
    """A block of tasks in groups of which one lesson does all, and its set."""
    rng = np.random.default_rng(seed)
    group = rng.integers(0, 3, size)
    rates = np.where(group[:, None] == group[None], 0.9, 0.1)
    pool = Tasks(tuple(f"task {i}" for i in range(size)), rng.random((size, 2)), group)
    block = Block(0, pool, pool.take(np.arange(1)))
    return block, TaskSet(seed, rng.permutation(size), np.arange(1)), np.concatenate([rates, rates[:1]])


@pytest.mark.parametrize("kind", KINDS)
def test_all_kinds_of_futures_have_one_mean(kind):
    counts = futures(kind, 10, 5.0, 4000, np.random.default_rng(0))
    assert counts.shape == (4000, 10)
    assert_allclose(counts.mean(axis=0), 0.5, atol=0.12)


def test_what_is_executed_as_planned_costs_as_planned():
    block, task_set, rates = made_up(8, 0)
    counts = futures("spread", 8, 4.0, 20, np.random.default_rng(1))
    program = two_days(REGIME, block, task_set.tasks[:4], rates[:8], counts)
    day = plan_two_stage(program).today
    assert executed_today(program.today, day) == pytest.approx(day.objective)
    worse = two_days(REGIME, block, task_set.tasks[:4], rates[:8] * 0.5, counts)
    assert executed_today(worse.today, day) > day.objective


def test_every_method_meets_the_same_futures():
    rows = []
    for seed in range(3):
        block, task_set, rates = made_up(8, seed)
        for kind in KINDS[:2]:
            rows += compare(0, block, task_set, REGIME, Truth(rates, rates), kind, 30, 20)
    frame = pd.DataFrame(rows)
    assert set(frame["method"]) == set(METHODS)
    assert_allclose(frame["executed_cost"], frame["planned_cost"])  # the table that plans were made with is true
    cost = frame.pivot_table(index=["set", "kind"], columns="method", values="planned_cost")
    assert (cost["hindsight"] <= cost.min(axis=1) * (1 + 1e-5)).all()
    table = tomorrow_table(frame, "made_up")
    mine = table[table["setting"] == "domain=made_up;regime=high_teaching;futures=lots"]
    saved = mine[(mine["method"] == "mean") & (mine["metric"] == "planned_cost_over_sample")].iloc[0]
    lots = cost.xs("lots", level="kind")
    assert saved["mean"] == pytest.approx((lots["mean"] - lots["sample"]).mean())
    assert saved["n"] == 3
