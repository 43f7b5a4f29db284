import time

import numpy as np
import pytest
from hypothesis import given, settings

from p2l.team import plan
from p2l.team.certificate import lagrangian_bound, proven_location_bound
from p2l.team.facility import branch, of_problem, of_table, solve_pairs, solve_program, tree
from p2l.team.facility.alarm import Alarm
from p2l.team.facility.dual_ascent import dual_ascent
from p2l.team.facility.fixing import fix, shrink, whole
from p2l.team.facility.greedy import greedy_solution, guarantee
from p2l.team.facility.local_search import columns_of, descend, open_cost
from p2l.team.facility.presolve import presolve, solution_cost
from p2l.team.facility.volume import CLOSED, OPEN, bound_of, raise_bound
from tests.team.team_instances import dense, problems, tables


def by_kernels(opening, service):
    whole = bool((opening == np.floor(opening)).all() and (service == np.floor(service)).all())
    return solve_pairs(of_table(opening, service), deadline=time.perf_counter() + 60.0, whole_numbers=whole)


@pytest.mark.parametrize("kind", "abc")
@pytest.mark.parametrize("seed", range(12))
def test_a_tree_that_shrinks_its_instances_equals_one_that_does_not(kind, seed, monkeypatch):
    opening, service = dense(70, kind, seed)
    fast = by_kernels(opening, service)
    monkeypatch.setattr(branch, "_WORTH_SHRINKING", 1 << 60)
    naive = by_kernels(opening, service)
    assert (fast.complete, naive.complete) == (True, True)
    assert fast.cost == naive.cost
    for solution in (fast, naive):
        assert proven_location_bound(opening, service, solution.certificate, solution.cost) == solution.cost


@pytest.mark.parametrize("kind", "abc")
def test_a_search_out_of_memory_goes_depth_first_and_finds_the_same(kind, monkeypatch):
    opening, service = dense(90, kind, 3)
    roomy = by_kernels(opening, service)
    monkeypatch.setattr(branch, "_MEMORY", 0)
    tight = by_kernels(opening, service)
    assert (tight.complete, tight.cost) == (True, roomy.cost)


@pytest.mark.parametrize(("size", "kind"), [(64, "a"), (40, "b"), (45, "c")])
def test_the_tree_equals_highs_where_enumeration_cannot_follow(size, kind):
    opening, service = dense(size, kind, 174)
    pairs = of_table(opening, service)
    program = solve_program(pairs, time_limit_s=60.0)
    assert program.complete
    assert by_kernels(opening, service).cost == open_cost(pairs, program.open)


@settings(max_examples=100)
@given(problems())
def test_the_fast_bound_is_the_bound_of_the_checker(problem):
    pairs = of_problem(problem)
    v = np.linspace(0.2, 1.0, problem.n) * pairs.outside
    free = np.zeros(problem.n, dtype=np.int8)
    assert bound_of(pairs, free, v) == pytest.approx(lagrangian_bound(problem, v), abs=1e-9)


@settings(max_examples=100)
@given(problems())
def test_dual_ascent_is_feasible_so_its_sum_is_its_bound(problem):
    pairs = of_problem(problem)
    v, _ = dual_ascent(pairs)
    assert (v <= pairs.outside + 1e-9).all()
    assert bound_of(pairs, np.zeros(problem.n, dtype=np.int8), v) == pytest.approx(v.sum(), abs=1e-6)


@settings(max_examples=100)
@given(problems())
def test_the_volume_bound_never_falls_and_never_passes_the_optimum(problem):
    pairs = of_problem(problem)
    best = plan(problem, "exhaustive").objective
    v, _ = dual_ascent(pairs)
    bound = raise_bound(pairs, np.zeros(problem.n, dtype=np.int8), v, best, 200)
    assert v.sum() - 1e-6 <= bound.value <= best * (1 + 1e-9) + 1e-9


@settings(max_examples=100)
@given(tables())
def test_no_single_move_improves_a_descended_plan(table):
    opening, service = table
    pairs = of_table(opening, service)
    everything = np.ones(len(opening), dtype=bool)
    open_set = descend(pairs, columns_of(pairs), np.zeros(len(opening), dtype=bool), everything)
    best = open_cost(pairs, open_set)
    slack = 1e-9 * pairs.outside.sum()
    for j in range(len(opening)):
        for k in range(len(opening)):
            trial = open_set.copy()
            trial[j] = not trial[j]
            trial[k] = trial[k] if j == k else not trial[k]
            swap = j == k or trial[j] != trial[k]  # two additions or two drops are no single move
            assert not swap or open_cost(pairs, trial) >= best - slack


@settings(max_examples=100)
@given(problems(largest=7))
def test_fixing_never_loses_a_better_plan(problem):
    pairs = of_problem(problem)
    lessons = plan(problem, "exhaustive").decision == 2
    best = open_cost(pairs, lessons)
    core = whole(pairs)
    v, incumbent = dual_ascent(pairs)
    upper = open_cost(pairs, incumbent)
    bound = raise_bound(pairs, core.state, v, upper, 50)
    if best < upper - 1e-9:
        state = fix(core.state, bound, upper - bound.value)
        assert not lessons[state == CLOSED].any()
        assert lessons[state == OPEN].all()
    smaller, _ = shrink(core, bound, upper - bound.value, incumbent)
    inside = lessons[smaller.origin]
    if best < upper - 1e-9:
        assert inside.sum() == lessons.sum()
        assert open_cost(smaller.pairs, inside) == pytest.approx(best)
    assert open_cost(smaller.pairs, incumbent[smaller.origin]) == pytest.approx(upper)


@settings(max_examples=100)
@given(problems())
def test_greedy_prices_shrunk_by_the_guarantee_are_a_feasible_dual(problem):
    pairs = of_problem(problem)
    open_set, v = greedy_solution(pairs)
    bound = bound_of(pairs, np.zeros(problem.n, dtype=np.int8), v)
    assert bound == pytest.approx(v.sum(), abs=1e-6)
    assert open_cost(pairs, open_set) <= guarantee(problem.n) * bound + 1e-6


def test_a_bound_of_the_tree_is_never_above_the_optimum():
    opening, service = dense(150, "b", 5)
    best = by_kernels(opening, service).cost
    for limit in (0.02, 0.1, 0.3):
        solution = solve_pairs(of_table(opening, service), deadline=time.perf_counter() + limit)
        assert proven_location_bound(opening, service, solution.certificate, solution.cost) <= best <= solution.cost


def test_a_proof_that_would_not_fit_in_memory_proves_less_and_nothing_wrong(monkeypatch):
    opening, service = dense(90, "b", 3)
    best = by_kernels(opening, service)
    monkeypatch.setattr(tree, "_MEMORY", 20 * 8 * 90)
    short = by_kernels(opening, service)
    assert short.cost == best.cost
    assert len(short.certificate.multipliers) <= 20
    assert proven_location_bound(opening, service, short.certificate, short.cost) < best.cost


@settings(max_examples=200)
@given(problems())
def test_presolving_keeps_the_optimum_and_leaves_only_numbers_that_a_solution_may_cost(problem):
    pairs = of_problem(problem)
    small, scale, known = presolve(pairs)
    upper = solution_cost(pairs, known)
    assert upper <= problem.n * plan(problem, "exhaustive").objective * (1 + 1e-12)
    assert np.isfinite(scale)
    largest = 2.0 * upper * scale * (1 + 1e-12) if upper else 1.0
    assert all((part <= largest).all() for part in (small.opening, small.outside, small.cost))
    lessons = plan(problem, "exhaustive").decision == 2
    assert open_cost(small, lessons) / scale == pytest.approx(open_cost(pairs, lessons))


def test_an_alarm_stops_kernels_at_a_valid_state():
    pairs = of_table(*dense(150, "b", 5))
    raised = np.ones(1, dtype=np.uint8)
    v, suggestion = dual_ascent(pairs, None, raised)
    assert bound_of(pairs, np.zeros(150, dtype=np.int8), v) == pytest.approx(v.sum())
    assert np.array_equal(descend(pairs, columns_of(pairs), suggestion, suggestion, raised), suggestion)
    bound = raise_bound(pairs, np.zeros(150, dtype=np.int8), v, np.inf, 1000, flag=raised)
    assert bound.value == pytest.approx(v.sum())
    with Alarm(time.perf_counter() + 0.05) as alarm:
        assert not alarm.rang
        while not alarm.flag[0]:
            time.sleep(0.005)
    assert alarm.rang
