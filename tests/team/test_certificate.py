"""The check that alone calls a plan optimal: what it accepts, and every lie that it refuses."""

import dataclasses
import math
from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings

from p2l.errors import ShapeError, SolverError
from p2l.team import Certificate, Problem, objective, plan, solve_facility_location
from p2l.team.certificate import check_certificate, check_facility_location, lagrangian_bound, proven_bound
from tests.team.team_instances import dense, geometric, problems, random_transfer

PROBLEM = geometric(50)
PLAN = plan(PROBLEM, "facility")
BRANCHED = random_transfer(80)
TREE = plan(BRANCHED, "facility")


def with_certificate(result, **change):
    return dataclasses.replace(result, certificate=dataclasses.replace(result.certificate, **change))


def raised(v):
    higher = v.copy()
    higher[0, 3] += 1.0
    return higher


def changed(values, place, value):
    other = values.copy()
    other[place] = value
    return other


@pytest.mark.parametrize("planner", ["highs", "facility", "greedy", "dual_ascent", "ad"])
def test_an_honest_certificate_passes(planner):
    result = plan(PROBLEM, planner)
    verdict = check_certificate(PROBLEM, result)
    assert verdict.cost == pytest.approx(result.objective)
    assert verdict.bound <= plan(PROBLEM).objective
    assert verdict.gap == pytest.approx(result.gap, abs=1e-9)
    assert verdict.optimal == (result.status == "optimal")


WORSE = plan(PROBLEM, "greedy")


@pytest.mark.parametrize(
    ("tampered", "message"),
    [
        (with_certificate(PLAN, multipliers=PLAN.certificate.multipliers * 0.9), "lower_bound is .* is proven"),
        (with_certificate(PLAN, multipliers=raised(PROBLEM.outside[None])), "above its outside option"),
        (with_certificate(PLAN, multipliers=PLAN.certificate.multipliers[:, :-1]), "49 multipliers given"),
        (dataclasses.replace(PLAN, objective=PLAN.objective - 1.0), "objective is"),
        (dataclasses.replace(PLAN, lower_bound=PLAN.objective + 1.0), "lower_bound is"),
        (dataclasses.replace(WORSE, lower_bound=WORSE.lower_bound + 1.0), "lower_bound is"),
        (dataclasses.replace(PLAN, lower_bound=float("nan")), "lower_bound is nan"),
        (dataclasses.replace(PLAN, gap=float("nan")), "gap is nan"),
        (dataclasses.replace(WORSE, gap=0.0), "gap is 0.0"),
        (dataclasses.replace(WORSE, status="optimal"), "status is 'optimal'"),
        (dataclasses.replace(PLAN, status="feasible"), "status is 'feasible'"),
        (dataclasses.replace(WORSE, status="optimal", gap=0.0, lower_bound=WORSE.objective), "lower_bound is"),
        (dataclasses.replace(PLAN, decision=np.zeros(50, dtype=np.int64)), "is .*, but the problem gives"),
        (dataclasses.replace(PLAN, expected_cost=PLAN.expected_cost[::-1].copy()), "expected_cost of task"),
        (dataclasses.replace(PLAN, skill=changed(PLAN.skill, 7, 999)), "skill of task 'part 7' is 999"),
        (dataclasses.replace(PLAN, p_success=np.ones(50)), "p_success of task"),
        (dataclasses.replace(PLAN, certificate=None), "none given"),
    ],
)
def test_a_tampered_one_is_refused(tampered, message):
    with pytest.raises(SolverError, match=message):
        check_certificate(PROBLEM, tampered)


def test_a_certificate_of_another_problem_is_refused():
    with pytest.raises(SolverError, match="certificate"):
        check_certificate(geometric(50, seed=1), PLAN)
    with pytest.raises(SolverError, match="a plan of 50 tasks; the problem has 51"):
        check_certificate(geometric(51), PLAN)


def test_a_tree_proves_what_no_single_multipliers_can():
    assert len(TREE.certificate.row) > 10
    assert check_certificate(BRANCHED, TREE).optimal
    alone = Certificate.of(TREE.certificate.multipliers[TREE.certificate.row[0]])
    assert proven_bound(BRANCHED, alone) < TREE.objective * (1.0 - 1e-6)


def test_a_tree_with_a_case_left_out_is_refused():
    nodes = len(TREE.certificate.row)
    parts = ("row", "parent", "facility", "is_open")
    for lost in range(1, nodes):
        if (TREE.certificate.parent == lost).any():
            continue
        left = np.arange(nodes) != lost
        parent = TREE.certificate.parent[left]
        fewer = {name: getattr(TREE.certificate, name)[left] for name in parts}
        fewer["parent"] = np.where(parent > lost, parent - 1, parent)
        if TREE.certificate.facility[lost] < 0:
            continue  # it decides nothing, so its parent is a leaf now
        with pytest.raises(SolverError, match="leave something out"):
            check_certificate(BRANCHED, with_certificate(TREE, **fewer))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"parent": changed(TREE.certificate.parent, 3, 5)}, "does not come after its parent"),
        ({"parent": changed(TREE.certificate.parent, 0, 0)}, "no root"),
        ({"facility": changed(TREE.certificate.facility, -1, 160)}, "a facility that does not exist"),
        ({"is_open": np.ones(len(TREE.certificate.row), dtype=bool)}, "leave something out"),
        ({"multipliers": TREE.certificate.multipliers * 0.99}, "lower_bound is"),
    ],
)
def test_a_tree_that_was_tampered_with_is_refused(change, message):
    with pytest.raises(SolverError, match=message):
        check_certificate(BRANCHED, with_certificate(TREE, **change))


def any_tree(problem, rng, target):
    """A tree that a stranger might send: random cases and prices."""
    parent, facility, is_open = [-1], [-1], [False]
    for lesson in rng.permutation(problem.n)[: rng.integers(0, problem.n + 1)].tolist():
        at = int(rng.choice(sorted(set(range(len(parent))) - set(parent))))
        if rng.random() < 0.3:
            parent, facility, is_open = [*parent, at], [*facility, -1], [*is_open, False]
            at = len(parent) - 1
        parent, facility, is_open = [*parent, at, at], [*facility, lesson, lesson], [*is_open, True, False]
    rows = rng.random((len(parent), problem.n)) ** rng.choice([0.2, 1.0, 3.0]) * problem.outside
    parts = (np.arange(len(parent)), np.array(parent), np.array(facility), np.array(is_open))
    return Certificate(rows, *parts, target)


def test_no_tree_whatsoever_proves_more_than_the_optimum():
    """A bound that an earlier node had proven once stood in for the node's own, and some trees proved too much."""
    informative = 0
    for seed in range(250):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 6))
        costs, transfer = rng.choice([0.0, 10.0, 100.0, 200.0], (4, n)), rng.choice([0.1, 0.5, 0.9, 1.0], (n, n))
        names, order = tuple(map(str, range(n))), ("fixed", "any")[seed % 2]
        problem = Problem(names, *costs, np.zeros(n), transfer, order)
        every = product(range(3), repeat=n)
        best = min(objective(problem, np.array(decision)).total for decision in every)
        for target in (best, 1.3 * best + 1.0, 2.0 * best + 5.0, 1e6):
            bound = proven_bound(problem, any_tree(problem, rng, target))
            assert bound <= best
            informative += bound > 0.8 * best
    assert informative > 100


@settings(max_examples=200)
@given(problems())
def test_rounding_counts_against_the_bound(problem):
    """In exact arithmetic L(v) is what it is; what is reported lies below it, by less than matters."""
    from fractions import Fraction

    v = np.minimum(problem.outside, np.linspace(0.1, 1.7, problem.n) * problem.outside)
    value = sum(map(Fraction, v.tolist()), Fraction(0))
    for j in range(problem.n):
        saving = Fraction(v[j])
        for i in range(problem.n):
            if i == j or (problem.order == "fixed" and i < j):
                continue
            risk = 1 - Fraction(problem.transfer[j, i])
            cost = Fraction(problem.c_rob[i]) + risk * Fraction(problem.c_fail[i])
            saving += max(Fraction(0), Fraction(v[i]) - cost)
        value += min(Fraction(0), Fraction(problem.c_demo[j]) - saving)
    bound = Fraction(lagrangian_bound(problem, v))
    assert bound <= value
    assert value - bound <= Fraction(1, 10**9) * (1 + sum(map(Fraction, problem.outside.tolist())))


def test_the_certificate_of_a_facility_location_solution_is_checked_too():
    rng = np.random.default_rng(0)
    opening, service = rng.uniform(1, 9, 12), rng.uniform(1, 9, (20, 12))
    solution = solve_facility_location(opening, service)
    assert check_facility_location(opening, service, solution).optimal
    closed = dataclasses.replace(solution, open=~solution.open)
    with pytest.raises(SolverError, match="not open"):
        check_facility_location(opening, service, closed)
    with pytest.raises(SolverError, match="cost is"):
        check_facility_location(opening, service, dataclasses.replace(solution, cost=solution.cost - 1))
    with pytest.raises(SolverError, match="lower_bound is"):
        check_facility_location(opening, service, dataclasses.replace(solution, lower_bound=solution.cost + 1.0))
    lower = solution.certificate.multipliers * 0.9
    with pytest.raises(SolverError, match="lower_bound is"):
        check_facility_location(opening, service, with_certificate(solution, multipliers=lower))


def test_whole_numbers_prove_up_to_the_next_one():
    opening, service = dense(60, "b", 1)
    solution = solve_facility_location(opening, service)
    assert check_facility_location(opening, service, solution).bound == solution.cost
    split = solve_facility_location(opening + 0.5, service)
    assert check_facility_location(opening + 0.5, service, split).optimal


def test_infinite_costs_mean_not_possible():
    problem = Problem(
        ("a", "b", "c"),
        c_rob=np.array([10.0, np.inf, 10.0]),
        c_hum=np.array([np.inf, 50.0, np.inf]),
        c_fail=np.array([100.0, 100.0, np.inf]),
        c_demo=np.array([200.0, np.inf, 300.0]),
        pretrained=np.array([0.9, 0.0, 0.5]),
        transfer=np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]),
    )
    # b: only the person; a: an attempt for 20, or the lesson for 200; c: its own lesson for 300, or that on a and 10
    best = plan(problem)
    assert (best.status, best.objective) == ("optimal", pytest.approx(200.0 + 50.0 + 10.0))
    assert check_certificate(problem, best).optimal


def test_a_target_or_prices_that_are_no_numbers_prove_nothing():
    """A target of NaN left every pair out, so that the sum of the outside options was proven, whatever the optimum."""
    one = np.zeros(1, dtype=np.int64)
    for target, v in ((math.nan, PROBLEM.outside), (0.0, np.full(50, -1.797e308)), (0.0, np.full(50, np.inf))):
        with pytest.raises(ShapeError, match=r"target: is NaN|multipliers: hold"):
            Certificate(v[None], one, one - 1, one - 1, one > 0, target)


def test_a_bound_above_the_cost_is_refused_whoever_is_wrong(monkeypatch):
    monkeypatch.setattr("p2l.team.certificate.tree_bound", lambda *_: PLAN.objective * 1.01)
    with pytest.raises(SolverError, match=r"proves that nothing costs less than .*; this costs"):
        check_certificate(PROBLEM, PLAN)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"status": "guaranteed best"}, "status 'guaranteed best' is unknown; known: optimal"),
        ({"skill": changed(PLAN.skill, int((PLAN.skill < 0).argmax()), 2**63 - 1)}, "skill of task"),
    ],
)
def test_words_and_numbers_out_of_range_are_refused(change, message):
    with pytest.raises(SolverError, match=message):
        check_certificate(PROBLEM, dataclasses.replace(PLAN, **change))


def test_optimal_means_to_a_billionth():
    one = np.ones(1)
    problem = Problem(("a",), 10 * one, 100 * one, 1000 * one, 100 * (1 - 1.5e-9) * one, 0 * one, np.zeros((1, 1)))
    worse = dataclasses.replace(plan(problem, "ad"), status="optimal", gap=0.99e-9, lower_bound=100 * (1 - 0.99e-9))
    with pytest.raises(SolverError, match=r"status is 'optimal', but a gap of 1\.5e-09 is proven"):
        check_certificate(problem, worse)
