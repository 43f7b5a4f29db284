import csv
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from p2l.errors import ConfigError, InputError, ShapeError
from p2l.team import solve_facility_location
from p2l.team.certificate import check_facility_location, proven_location_bound
from p2l.team.facility import location, of_table, read_instance
from p2l.team.facility.program import solve_in_cases
from tests.team.team_instances import cheapest_by_hand, dense, facility_cost, tables

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
@given(tables(), st.sampled_from([0, location.FEW_PAIRS]))
def test_both_routes_equal_enumeration(table, few_pairs):
    opening, service = table
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(location, "FEW_PAIRS", few_pairs)
        solution = solve_facility_location(opening, service, time_limit_s=30, gap=0.0)
    assert solution.status == "optimal"
    assert solution.cost == pytest.approx(cheapest_by_hand(opening, service), rel=1e-8)
    assert solution.cost == pytest.approx(facility_cost(opening, service, solution.open), rel=1e-12)
    assert solution.lower_bound <= solution.cost
    assert solution.open[solution.assignment].all()
    assert check_facility_location(opening, service, solution).optimal


@pytest.mark.parametrize("few_pairs", [0, location.FEW_PAIRS])
@pytest.mark.parametrize("integral", [True, False])
@pytest.mark.parametrize("seed", range(4))
def test_instances_with_a_large_gap_need_the_tree_and_are_still_exact(seed, integral, few_pairs, monkeypatch):
    # opening costs far above the spread of the service costs: the relaxation is several percent off
    rng = np.random.default_rng(seed)
    service = rng.integers(1000, 2000, (30, 15)) + (0 if integral else rng.random((30, 15)))
    opening = rng.integers(1000, 2000, 15).astype(float)
    monkeypatch.setattr(location, "FEW_PAIRS", few_pairs)
    solution = solve_facility_location(opening, service.astype(float))
    assert solution.status == "optimal"
    assert solution.cost == pytest.approx(cheapest_by_hand(opening, service))
    assert check_facility_location(opening, service, solution).optimal


@settings(max_examples=100)
@given(tables(), st.booleans())
def test_branching_on_the_relaxation_is_exact_and_proven(table, tight):
    """Or says that its cases did not suffice."""
    opening, service = table
    pairs = of_table(opening, service)
    assume(len(pairs.cost))
    found = solve_in_cases(pairs, deadline=time.perf_counter() + 30.0, gap=0.0, most=1 if tight else 1_000)
    if found is None:
        assert tight
        return
    optimum = cheapest_by_hand(opening, service)
    assert found.cost == pytest.approx(optimum, rel=1e-9)
    assert proven_location_bound(opening, service, found.certificate, found.cost) == pytest.approx(optimum, rel=1e-9)


def test_tiny_instances_are_branched_on_without_kernels():
    """Two of three: every relaxation opens halves. The kernels took half a second to load."""
    code = (
        "import sys, numpy as np; from p2l import solve_facility_location\n"
        "service = np.where(np.eye(3, dtype=bool), 9.0, 1.0)\n"
        "solution = solve_facility_location(np.full(3, 4.0), service)\n"
        "print(solution.status, solution.cost, len(solution.certificate.row) > 1, 'numba' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == ["optimal", "11.0", "True", "False"]


def test_a_timed_out_search_says_so_and_its_bound_is_true():
    opening, service = dense(150, "b", 5)
    start = time.perf_counter()
    early = solve_facility_location(opening, service, time_limit_s=0.1)
    assert time.perf_counter() - start < 10.0  # generous: the limit is kept, not ignored
    late = solve_facility_location(opening, service, time_limit_s=60.0)
    assert early.status == "time_limit"
    assert late.status == "optimal"
    assert early.lower_bound <= late.cost <= early.cost


def test_a_requested_gap_ends_the_search_early():
    opening, service = dense(150, "b", 5)
    solution = solve_facility_location(opening, service, time_limit_s=60.0, gap=0.03)
    assert solution.status == "feasible"
    assert 0.0 < solution.gap <= 0.03


@pytest.mark.parametrize(
    ("opening", "service", "options", "error", "message"),
    [
        (np.array([1.0, np.nan]), np.ones((3, 2)), {}, ShapeError, "opening_cost: holds NaN"),
        (np.ones(2), np.full((3, 2), np.inf), {}, ShapeError, "service_cost: no facility can serve demand 0"),
        (np.full(2, np.inf), np.ones((3, 2)), {}, ShapeError, "service_cost: no facility can serve demand 0"),
        (np.ones(2), np.ones((3, 2)), {"time_limit_s": "5"}, ConfigError, "time_limit_s: '5' given; expected a number"),
        (np.ones(2), np.ones((3, 2)), {"gap": None}, ConfigError, "gap: None given; expected a number"),
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


@pytest.mark.parametrize("never", [1e12, 1e15, 1e50, np.inf])
@pytest.mark.parametrize("seed", range(12))
def test_a_cost_that_means_never_changes_nothing(seed, never):
    """One opening cost of 1e12 once made 54 of 60 solutions wrong, by up to 90 %, with bounds above the optimum."""
    rng = np.random.default_rng(seed)
    opening, service = rng.uniform(1.0, 300.0, 7), rng.uniform(0.0, 300.0, (8, 7))
    opening[seed % 7], service[seed % 8, (seed + 1) % 7] = never, never
    solution = solve_facility_location(opening, service)
    usable = np.isfinite(opening) & (opening < 1e6)
    finite = np.where(np.isinf(service), 1e9, service)
    assert solution.status == "optimal"
    assert solution.cost == pytest.approx(cheapest_by_hand(opening[usable], finite[:, usable]), rel=1e-12)
    assert check_facility_location(opening, service, solution).optimal
