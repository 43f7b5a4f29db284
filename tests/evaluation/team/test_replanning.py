"""The table of planning anew: savings and prices paired by set, and the share of the price that is gained back."""

import numpy as np
import pandas as pd
import pytest

from p2l.evaluation.team.replanning import ReplanningVariant, replanning_table
from p2l.seeding import generator
from p2l.team.day.simulation import WAYS

COSTS = {"once": (100.0, 140.0), "outcomes": (100.0, 130.0), "simulated": (90.0, 110.0), "ahead": (85.0, 105.0)}


def variant(true=(80.0, 100.0)):
    rows = [
        {"set": index, "regime": regime, "level": 0, "way": way, "cost": cost[index], "demos": 1.0, "delegated": 0.0,
         "failures": 2.0}
        for way, cost in {**COSTS, "adl_true": true}.items()
        for regime in ("high", "low")
        for index in (0, 1)
    ]  # fmt: skip
    return ReplanningVariant("lego", "concatenation", "predicted", pd.DataFrame(rows))


def value(table, way, metric, case="regime=all;pretrained=all"):
    setting = f"domain=lego;predictor=concatenation;skills=predicted;{case}"
    [mean] = table[(table.method == way) & (table.metric == metric) & (table.setting == setting)]["mean"]
    return mean


def test_savings_prices_and_shares():
    """`once` pays 20 and 40 more than the truth; `simulated` saves 10 and 30 of them."""
    table = replanning_table([variant()], generator(0, "test"))
    for case in ("regime=all;pretrained=all", "regime=high;pretrained=0", "regime=low;pretrained=0"):
        assert value(table, "once", "executed_price", case) == 30.0
        assert value(table, "simulated", "executed_saving", case) == 20.0
        assert value(table, "simulated", "executed_price", case) == 10.0
        assert value(table, "simulated", "price_regained", case) == pytest.approx(2 / 3)
        assert value(table, "outcomes", "price_regained", case) == pytest.approx(1 / 6)
    assert set(table.method) == {*WAYS, "adl_true"}
    assert (table.n == 2).all()
    again = replanning_table([variant()], generator(0, "test"))
    pd.testing.assert_frame_equal(table, again)


def test_without_a_price_there_is_no_share():
    table = replanning_table([variant(true=(100.0, 140.0))], generator(0, "test"))
    assert "price_regained" not in set(table.metric)
    assert np.isfinite(value(table, "ahead", "executed_saving"))
