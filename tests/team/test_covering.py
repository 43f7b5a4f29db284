import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from p2l.team.facility import of_table
from p2l.team.facility.alarm import silent
from p2l.team.facility.covering import cover, is_covering
from p2l.team.facility.fixing import shrink, whole
from p2l.team.facility.local_search import columns_of, descend, open_cost
from p2l.team.facility.presolve import presolve
from p2l.team.facility.tabu import Trail, wander
from p2l.team.facility.volume import OPEN, Pace, raise_bound
from p2l.team.facility.walk import Walk
from tests.team.team_instances import cheapest_by_hand, covering, dense, tables


def searched(pairs, open_set, count, effort, *, seed=0, flag=None):
    trail = Trail(open_set, float(open_cost(pairs, open_set)), open_set)
    rng = np.random.default_rng(seed)
    return cover(pairs, columns_of(pairs), trail, count, effort, rng, silent() if flag is None else flag)


@settings(max_examples=100)
@given(tables(), st.integers(0, 5), st.integers(0, 99))
def test_a_search_keeps_its_best_plan_at_the_cost_it_says(table, count, seed):
    opening, service = table
    pairs = of_table(opening, service)
    start = np.zeros(len(opening), dtype=bool)
    trail = searched(pairs, start, count, 2000, seed=seed)
    assert trail.cost == pytest.approx(float(open_cost(pairs, trail.best)), rel=1e-12)
    assert trail.cost <= open_cost(pairs, start)
    assert trail.cost >= cheapest_by_hand(opening, service) * (1.0 - 1e-12)


def test_it_opens_so_many_and_ends_where_a_flag_is_raised():
    pairs = presolve(of_table(*covering(0))).pairs
    start = np.zeros(60, dtype=bool)
    once, again, other = (searched(pairs, start, 9, 1e5, seed=seed) for seed in (3, 3, 4))
    assert once.last.sum() == 9
    assert np.array_equal(once.last, again.last)
    assert not np.array_equal(once.last, other.last)
    assert not searched(pairs, start, 9, 1e9, flag=np.ones(1, dtype=np.uint8)).last.any()


def test_what_is_a_cover_and_what_is_not():
    assert is_covering(of_table(*covering(0)))
    assert not is_covering(of_table(*dense(60, "b", 0)))
    opening, service = covering(0)
    assert not is_covering(of_table(opening / 100.0, service))  # all services together differ by more
    pairs = of_table(opening, service)
    assert not is_covering(pairs._replace(outside=np.full(60, 100.0)))  # to serve none is cheap
    assert not is_covering(of_table(np.ones(2), np.full((3, 2), 1.0))._replace(start=np.zeros(4, dtype=np.int64)))


@pytest.mark.parametrize(("places", "seed", "fewest"), [(100, 2, 14), (120, 0, 17), (120, 1, 17)])
def test_it_finds_fewer_facilities_than_tabu_search_with_ten_times_the_work(places, seed, fewest):
    pairs, nothing = of_table(*covering(seed, places)), np.zeros(places, dtype=bool)
    start = descend(pairs, columns_of(pairs), nothing, ~nothing)
    upper = float(open_cost(pairs, start))
    walk = Walk(pairs, start, upper, np.random.default_rng(0))
    assert walk.patiently(2e7, silent()).best.sum() == fewest
    columns, rng, trail = columns_of(pairs), np.random.default_rng(0), Trail(start, upper, start)
    for turn in range(8):
        trail = wander(pairs, columns, trail, 2.5e7, rng, steepest=turn % 2 == 0)
    assert trail.best.sum() > fewest


@settings(max_examples=100)
@given(tables(), st.floats(0.0, 20.0), st.integers(0, 99))
def test_a_smaller_instance_holds_what_costs_no_more_than_the_gap(table, gap, seed):
    opening, service = table
    pairs, rng = of_table(opening, service), np.random.default_rng(seed)
    core, keep = whole(pairs), rng.random(len(opening)) < 0.3
    bound = raise_bound(pairs, core.state, rng.random(pairs.demands) * pairs.outside, np.inf, 0)
    smaller, moved = shrink(core, bound, gap, keep)
    is_open = bound.reduced_cost < -gap
    stays = keep | (bound.reduced_cost <= gap)
    assert np.array_equal(smaller.origin, np.flatnonzero(stays))
    assert np.array_equal(smaller.state == OPEN, is_open[stays])
    assert np.array_equal(moved.reduced_cost, bound.reduced_cost[stays])
    rows, detour = pairs.rows(), np.where(is_open, 0.0, np.maximum(bound.reduced_cost, 0.0))
    above = np.maximum(pairs.cost - bound.multipliers[rows], 0.0)
    wanted = keep[pairs.facility] | (detour[pairs.facility] + above <= gap)
    assert np.array_equal(smaller.pairs.rows(), rows[wanted])
    assert np.array_equal(smaller.origin[smaller.pairs.facility], pairs.facility[wanted])
    assert np.array_equal(smaller.pairs.cost, pairs.cost[wanted])
    if len(pairs.cost):
        assert (shrink(core, bound, gap, keep, 0.5) is None) == (wanted.mean() > 0.5)


def test_a_pace_ends_where_the_bound_comes_no_nearer():
    pairs = of_table(*dense(80, "b", 0))
    state, start = whole(pairs).state, pairs.cost[pairs.start[:-1]]
    upper = float(open_cost(pairs, np.ones(80, dtype=bool)))
    never, once = (raise_bound(pairs, state, start, upper, 300, pace=Pace(0.03, 30, least)) for least in (0.0, 1.0))
    thirty = raise_bound(pairs, state, start, upper, 30, pace=Pace(0.03, 30, 0.0))
    assert once.value == thirty.value < never.value
