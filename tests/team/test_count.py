import dataclasses
import time

import numpy as np
import pytest

from p2l.errors import ShapeError, SolverError
from p2l.team import solve_facility_location
from p2l.team.cases import Instance, tree_bound
from p2l.team.certificate import check_facility_location, proven_location_bound
from p2l.team.facility import of_table, solve_pairs, solve_program
from p2l.team.facility.alarm import Alarm
from p2l.team.facility.branch import Incumbent, Target, branch_and_bound
from p2l.team.facility.count import count_cases, whole_search
from p2l.team.facility.dual_ascent import dual_ascent
from p2l.team.facility.fixing import whole
from p2l.team.facility.local_search import open_cost
from p2l.team.facility.presolve import presolve
from p2l.team.facility.tree import Tree
from p2l.team.facility.volume import raise_bound
from p2l.team.facility.walk import Walk
from p2l.team.problem import Certificate
from tests.team.team_instances import cheapest_by_hand, covering

PLACES = 36
OPENING, SERVICE = covering(3, PLACES)
SOLUTION = solve_facility_location(OPENING, SERVICE)
PROOF = SOLUTION.certificate


def doctored(**change):
    return dataclasses.replace(SOLUTION, certificate=dataclasses.replace(PROOF, **change))


@pytest.mark.parametrize("seed", [2, 3])
def test_cases_of_how_many_are_open_prove_what_highs_says(seed):
    opening, service = covering(seed, PLACES)
    solution = solve_facility_location(opening, service)
    assert (solution.certificate.facility >= PLACES).sum() == 2
    assert check_facility_location(opening, service, solution).optimal
    pairs = of_table(opening, service)
    program = solve_program(pairs, time_limit_s=60.0)
    assert solution.cost == open_cost(pairs, program.open)


def test_a_proof_without_its_counts_or_with_other_ones_is_refused():
    cases = np.flatnonzero(PROOF.facility >= PLACES)
    for number in (PLACES + 3, 2 * PLACES - 1, PLACES):
        other = PROOF.facility.copy()
        other[cases] = number
        with pytest.raises(SolverError, match="lower_bound is"):
            check_facility_location(OPENING, SERVICE, doctored(facility=other))
    for facility, message in ((2 * PLACES, "does not exist"), (cases[0], "leave something out")):
        other = PROOF.facility.copy()
        other[cases[0]] = facility
        with pytest.raises(SolverError, match=message):
            check_facility_location(OPENING, SERVICE, doctored(facility=other))
    other = PROOF.is_open.copy()
    other[cases] = ~other[cases]
    with pytest.raises(SolverError, match="lower_bound is"):
        check_facility_location(OPENING, SERVICE, doctored(is_open=other))


def test_prices_of_the_count_cannot_be_made_up():
    assert PROOF.count_prices.any()
    for change, message in ((0.0 * PROOF.count_prices, "above its outside"), (0.9 * PROOF.count_prices, "lower_bound")):
        with pytest.raises(SolverError, match=message):
            check_facility_location(OPENING, SERVICE, doctored(count_prices=change))
    with pytest.raises(ShapeError, match="count_prices"):
        dataclasses.replace(PROOF, count_prices=PROOF.count_prices[:-1])
    with pytest.raises(ShapeError, match="count_prices"):
        dataclasses.replace(PROOF, count_prices=np.full(len(PROOF.row), np.nan))


def any_tree(facilities, outside, rng, target):
    """A tree that a stranger might send: random cases of facilities and of counts, random prices."""
    parent, facility, is_open = [-1], [-1], [False]
    for _ in range(int(rng.integers(1, 8))):
        at = int(rng.choice(sorted(set(range(len(parent))) - set(parent))))
        chosen = int(rng.integers(0, 2 * facilities))
        parent, facility, is_open = [*parent, at, at], [*facility, chosen, chosen], [*is_open, True, False]
    nodes = len(parent)
    prices = rng.choice([0.0, 0.3, 0.9, 1.0, -0.5, -3.0, -50.0], nodes) * rng.choice([1.0, 10.0])
    rows = rng.random((nodes, len(outside))) ** rng.choice([0.2, 1.0]) * (outside + np.maximum(0.0, -prices[:, None]))
    parts = (np.arange(nodes), np.array(parent), np.array(facility), np.array(is_open))
    return Certificate(rows, *parts, target, count_prices=prices)


def test_no_tree_of_counts_whatsoever_proves_more_than_the_optimum():
    informative = 0
    for seed in range(300):
        rng = np.random.default_rng(seed)
        opening = rng.choice([8.0, 10.0, 12.0], 4)
        service = np.where(rng.random((5, 4)) < 0.4, rng.integers(0, 4, (5, 4)), 40.0)
        best = cheapest_by_hand(opening, service)
        outside = (opening + service).min(axis=1)
        instance = Instance(opening, outside, tuple("abcde"), lambda low, high, table=service: table[low:high])
        for target in (best, 1.2 * best, 2.0 * best):
            bound = tree_bound(instance, any_tree(4, outside, rng, target))
            assert bound <= best
            informative += bound > 0.8 * best
    assert informative > 50


def test_an_interrupted_proof_says_what_the_costs_give():
    opening, service = covering(5, 90)
    pairs = of_table(opening, service)
    for seconds in (0.3, 0.8):
        early = solve_pairs(pairs, deadline=time.perf_counter() + seconds, whole_numbers=True, counting=True)
        bound = proven_location_bound(opening, service, early.certificate, early.cost)
        assert bound >= early.certificate.target * (1.0 - 1e-9) > 0.5 * early.cost
        assert bound <= early.cost


class Counted(Alarm):
    """Rings after so many looks at it, whatever the machine does."""

    def __init__(self, looks):
        super().__init__(np.inf)
        self.looks = looks

    @property
    def rang(self):
        self.looks -= 1
        return self.looks < 0


@pytest.mark.parametrize("nodes", [0, 1, 300, 700, 850, 912])
def test_cases_interrupted_after_some_nodes_prove_what_they_say(nodes):
    opening, service = covering(5, 90)
    pairs = of_table(opening, service)
    small, scale, _ = presolve(pairs)
    start = dual_ascent(small)[0]
    core, tree = whole(small), Tree(start, small.facilities)
    open_set = solve_pairs(pairs, deadline=np.inf, whole_numbers=True, counting=True).open
    best = Incumbent(open_set, float(open_cost(small, open_set)))
    target = Target(unit=scale)
    bound = raise_bound(small, core.state, start, target.cutoff(best.upper), 300)
    tree.price(0, bound.multipliers)
    with Alarm(np.inf) as alarm:
        few, many = count_cases(
            whole_search(core, bound, 0), open_set, best.upper, target.cutoff(best.upper), tree, alarm
        )
    walk = Walk(small, open_set, best.upper, np.random.default_rng(0))
    with Alarm(np.inf) as never:
        assert branch_and_bound(core, many, best, target, tree, walk, never).complete
    search = branch_and_bound(core, few, best, target, tree, walk, Counted(nodes))
    proven = proven_location_bound(opening, service, tree.certificate(search.lower, scale), best.upper / scale)
    assert proven >= search.lower / scale > bound.value / scale
