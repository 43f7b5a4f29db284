import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from p2l.team.facility import of_table
from p2l.team.facility.alarm import silent
from p2l.team.facility.local_search import columns_of, descend, open_cost
from p2l.team.facility.tabu import Trail, wander
from p2l.team.facility.walk import Walk
from tests.team.team_instances import cheapest_by_hand, covering, dense, tables


def walked(pairs, open_set, effort, *, steepest, seed=0, flag=None):
    trail = Trail(open_set, float(open_cost(pairs, open_set)), open_set)
    rng = np.random.default_rng(seed)
    return wander(pairs, columns_of(pairs), trail, effort, rng, steepest=steepest, flag=flag)


@settings(max_examples=100)
@given(tables(), st.booleans(), st.integers(0, 99))
def test_a_walk_keeps_its_best_plan_at_the_cost_it_says(table, steepest, seed):
    opening, service = table
    pairs = of_table(opening, service)
    start = np.zeros(len(opening), dtype=bool)
    trail = walked(pairs, start, 2000, steepest=steepest, seed=seed)
    assert trail.cost == pytest.approx(float(open_cost(pairs, trail.best)), rel=1e-12)
    assert trail.cost <= open_cost(pairs, start)
    assert trail.cost >= cheapest_by_hand(opening, service) * (1.0 - 1e-12)


@pytest.mark.parametrize("steepest", [True, False])
def test_the_same_seed_walks_the_same_way_and_another_does_not(steepest):
    pairs = of_table(*covering(0))
    start = np.zeros(60, dtype=bool)
    once, again, other = (walked(pairs, start, 1e5, steepest=steepest, seed=seed) for seed in (3, 3, 4))
    assert once.cost == again.cost
    assert np.array_equal(once.last, again.last)
    assert not np.array_equal(once.last, other.last)


def test_a_flag_stops_it_where_it_stands():
    pairs = of_table(*dense(80, "b", 0))
    start = np.zeros(80, dtype=bool)
    trail = walked(pairs, start, 1e9, steepest=True, flag=np.ones(1, dtype=np.uint8))
    assert np.array_equal(trail.best, start)
    assert np.array_equal(trail.last, start)


def test_it_leaves_the_local_optima_that_moves_of_one_or_two_end_in():
    better = 0
    for seed in range(5):
        pairs = of_table(*covering(seed))
        start = descend(pairs, columns_of(pairs), np.zeros(60, dtype=bool), np.ones(60, dtype=bool))
        upper = float(open_cost(pairs, start))
        walk = Walk(pairs, start, upper, np.random.default_rng(0))
        trail = walk.patiently(1e6, silent())
        assert trail.cost <= upper
        assert walk.cost == trail.cost
        better += trail.cost < upper - 1000.0
    assert better >= 3


def test_a_walk_goes_on_from_a_plan_found_elsewhere():
    pairs = of_table(*dense(60, "b", 0))
    nothing = np.zeros(60, dtype=bool)
    best = walked(pairs, nothing, 1e6, steepest=True)
    walk = Walk(pairs, nothing, float(open_cost(pairs, nothing)), np.random.default_rng(0))
    walk.goes_on_from(best.best, best.cost)
    assert walk.further(1.0, silent()).cost == best.cost
