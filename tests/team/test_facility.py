import csv
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings

from p2l.errors import ConfigError, InputError, ShapeError
from p2l.team import plan, solve_facility_location
from p2l.team.certificate import check_facility_location, lagrangian_bound
from p2l.team.facility import branch
from p2l.team.facility.core import solve_core
from p2l.team.facility.dual_ascent import dual_ascent
from p2l.team.facility.fixing import fix, shrink, whole
from p2l.team.facility.greedy import greedy, guarantee
from p2l.team.facility.local_search import columns_of, descend, open_cost
from p2l.team.facility.orlib import read_instance
from p2l.team.facility.pairs import of_problem, of_table
from p2l.team.facility.reduction import facility_cost
from p2l.team.facility.solve import load_kernels, solve_pairs
from p2l.team.facility.volume import CLOSED, OPEN, bound_of, raise_bound
from tests.team.team_instances import cheapest_by_hand, problems, tables

UFL = Path(__file__).parents[2] / "data" / "ufl"


def optima():
    with (UFL / "optima.csv").open(encoding="utf-8", newline="") as stream:
        return [(row["instance"], float(row["optimum"])) for row in csv.DictReader(stream)]


@pytest.mark.parametrize(("name", "optimum"), optima())
def test_public_instances_are_proven_to_their_optima(name, optimum):
    opening, service = read_instance(UFL / f"{name}.txt")
    solution = solve_facility_location(opening, service, time_limit_s=30, gap=0.0)
    assert solution.status == "optimal"
    assert solution.cost == pytest.approx(optimum, abs=1e-3)
    assert solution.gap <= 1e-9
    check_facility_location(opening, service, solution)


@settings(max_examples=200)
@given(tables())
def test_the_solver_equals_enumeration(table):
    opening, service = table
    solution = solve_facility_location(opening, service, time_limit_s=30, gap=0.0)
    assert solution.status == "optimal"
    assert solution.cost == pytest.approx(cheapest_by_hand(opening, service), rel=1e-8)
    assert solution.cost == pytest.approx(facility_cost(opening, service, solution.open), rel=1e-12)
    assert solution.lower_bound <= solution.cost
    assert solution.open[solution.assignment].all()
    assert check_facility_location(opening, service, solution).bound <= solution.cost * (1 + 1e-9)


@pytest.mark.parametrize("integral", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_instances_with_a_large_gap_need_the_tree_and_are_still_exact(seed, integral):
    # opening costs far above the spread of the service costs: the relaxation is several percent off
    rng = np.random.default_rng(seed)
    service = rng.integers(1000, 2000, (30, 15)) + (0 if integral else rng.random((30, 15)))
    opening = rng.integers(1000, 2000, 15).astype(float)
    load_kernels()
    solution = solve_facility_location(opening, service.astype(float))
    assert solution.status == "optimal"
    assert solution.cost == pytest.approx(cheapest_by_hand(opening, service))
    assert check_facility_location(opening, service, solution).gap > 0.0


def dense(size, kind, seed):
    """Like Koerkel and Ghosh: random service costs, opening costs of three magnitudes, large gaps."""
    rng = np.random.default_rng(seed)
    low = {"a": 100, "b": 1000, "c": 10_000}[kind]
    opening = rng.integers(low, 2 * low + 1, size).astype(float)
    return opening, rng.integers(1000, 2001, (size, size)).astype(float)


@pytest.mark.parametrize("kind", "abc")
@pytest.mark.parametrize("seed", range(12))
def test_a_tree_that_shrinks_its_instances_equals_one_that_does_not(kind, seed, monkeypatch):
    opening, service = dense(70, kind, seed)
    fast = solve_facility_location(opening, service)
    monkeypatch.setattr(branch, "_WORTH_SHRINKING", 1 << 60)
    naive = solve_facility_location(opening, service)
    assert (fast.status, naive.status) == ("optimal", "optimal")
    assert fast.cost == naive.cost


@pytest.mark.parametrize("kind", "abc")
def test_a_search_out_of_memory_goes_depth_first_and_finds_the_same(kind, monkeypatch):
    opening, service = dense(90, kind, 3)
    roomy = solve_facility_location(opening, service)
    monkeypatch.setattr(branch, "_MEMORY", 0)
    tight = solve_facility_location(opening, service)
    assert (tight.status, tight.cost) == ("optimal", roomy.cost)


@pytest.mark.parametrize(("size", "kind"), [(64, "a"), (40, "b"), (45, "c")])
def test_the_tree_equals_highs_where_enumeration_cannot_follow(size, kind):
    opening, service = dense(size, kind, 174)
    pairs = of_table(opening, service)
    answer = solve_core(pairs, time_limit_s=60.0)
    assert answer.finished
    assert solve_facility_location(opening, service).cost == open_cost(pairs, answer.open)


def hard():
    return dense(150, "b", 5)


def test_a_timed_out_search_says_so_and_its_bound_is_true():
    opening, service = hard()
    began = time.perf_counter()
    early = solve_facility_location(opening, service, time_limit_s=0.1)
    assert time.perf_counter() - began < 10.0  # generous: the limit is kept, not ignored
    late = solve_facility_location(opening, service, time_limit_s=60.0)
    assert early.status == "time_limit"
    assert late.status == "optimal"
    assert early.lower_bound <= late.cost <= early.cost


def test_a_requested_gap_ends_the_search_early():
    opening, service = hard()
    solution = solve_facility_location(opening, service, time_limit_s=60.0, gap=0.03)
    assert solution.status == "feasible"
    assert 0.0 < solution.gap <= 0.03


@pytest.mark.parametrize(
    ("opening", "service", "options", "error", "message"),
    [
        (np.array([1.0, np.nan]), np.ones((3, 2)), {}, ShapeError, "opening_cost: holds NaN"),
        (np.ones(2), np.full((3, 2), np.inf), {}, ShapeError, "service_cost: holds NaN or infinity"),
        (np.array([1.0, -1.0]), np.ones((3, 2)), {}, ShapeError, "opening_cost: holds -1.0"),
        (np.ones(2), -np.ones((3, 2)), {}, ShapeError, "service_cost: holds -1.0"),
        (np.ones(2), np.ones((3, 4)), {}, ShapeError, "service_cost: axis 1 has length 4"),
        (np.ones(2), np.ones(2), {}, ShapeError, "service_cost: has 1 axes"),
        (np.ones(0), np.ones((3, 0)), {}, ShapeError, "at least one demand and one facility"),
        (np.ones(2), np.ones((0, 2)), {}, ShapeError, "at least one demand and one facility"),
        (np.ones(2), np.ones((3, 2)), {"time_limit_s": 0.0}, ConfigError, "time_limit_s: 0.0"),
        (np.ones(2), np.ones((3, 2)), {"gap": -0.1}, ConfigError, "gap: -0.1"),
    ],
)
def test_bad_input_gets_one_message(opening, service, options, error, message):
    with pytest.raises(error, match=message):
        solve_facility_location(opening, service, **options)


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
    opened = descend(pairs, columns_of(pairs), np.zeros(len(opening), dtype=bool), everything)
    reached = open_cost(pairs, opened)
    slack = 1e-9 * pairs.outside.sum()
    for j in range(len(opening)):
        for k in range(len(opening)):
            trial = opened.copy()
            trial[j] = not trial[j]
            trial[k] = trial[k] if j == k else not trial[k]
            swap = j == k or trial[j] != trial[k]  # two additions or two drops are no single move
            assert not swap or open_cost(pairs, trial) >= reached - slack


@settings(max_examples=100)
@given(problems(largest=7))
def test_fixing_never_loses_a_better_plan(problem):
    pairs = of_problem(problem)
    lessons = plan(problem, "exhaustive").decision == 2
    best = open_cost(pairs, lessons)
    core = whole(pairs)
    v, known = dual_ascent(pairs)
    upper = open_cost(pairs, known)
    bound = raise_bound(pairs, core.state, v, upper, 50)
    if best < upper - 1e-9:
        state = fix(core.state, bound, upper - bound.value)
        assert not lessons[state == CLOSED].any()
        assert lessons[state == OPEN].all()
    smaller, _ = shrink(core, bound, upper - bound.value, known)
    inside = lessons[smaller.origin]
    if best < upper - 1e-9:
        assert inside.sum() == lessons.sum()
        assert open_cost(smaller.pairs, inside) == pytest.approx(best)
    assert open_cost(smaller.pairs, known[smaller.origin]) == pytest.approx(upper)


@settings(max_examples=100)
@given(problems())
def test_greedy_prices_shrunk_by_the_guarantee_are_a_feasible_dual(problem):
    pairs = of_problem(problem)
    opened, v = greedy(pairs)
    bound = bound_of(pairs, np.zeros(problem.n, dtype=np.int8), v)
    assert bound == pytest.approx(v.sum(), abs=1e-6)
    assert open_cost(pairs, opened) <= guarantee(problem.n) * bound + 1e-6


def test_a_bound_of_the_tree_is_never_above_the_optimum():
    opening, service = hard()
    pairs = of_table(opening, service)
    best = solve_facility_location(opening, service).cost
    for limit in (0.02, 0.1, 0.3):
        found = solve_pairs(pairs, deadline=time.perf_counter() + limit)
        assert found.lower_bound <= best <= found.cost


def test_both_text_formats_are_read(tmp_path):
    (tmp_path / "or.txt").write_text("2 3\ncapacity 5.\n100 6\n7 1 2\n8 3\n4\n9 5 6\n")
    (tmp_path / "uf.txt").write_text("FILE: uf.txt\n2 3 0\n1 5 1 3 5\n2 6 2 4 6\n")
    for name in ("or.txt", "uf.txt"):
        opening, service = read_instance(tmp_path / name)
        assert opening.tolist() == [5.0, 6.0]
        assert service.tolist() == [[1.0, 2.0], [3.0, 4.0], [5.0, 6.0]]


def test_a_broken_instance_file_is_named(tmp_path):
    (tmp_path / "short.txt").write_text("2 3\n1 5\n")
    for name in ("short.txt", "absent.txt"):
        with pytest.raises(InputError, match=name):
            read_instance(tmp_path / name)


@pytest.mark.parametrize(
    ("opening", "service", "message"),
    [
        ([1e101], [[1.0]], r"opening_cost: holds 1e\+101; expected values of at most 1e\+100"),
        ([1.0], [[1e308]], r"service_cost: holds 1e\+308; expected values of at most 1e\+100"),
        ([1.0 + 2.0j], [[1.0]], "opening_cost: holds complex numbers; expected real ones"),
        ([1.0], [[1j]], "service_cost: holds complex numbers"),
    ],
)
def test_costs_that_overflow_or_are_complex_are_refused(opening, service, message):
    with pytest.raises(ShapeError, match=message):
        solve_facility_location(np.array(opening), np.array(service))
