"""The same input takes the same route in every process, whatever has been loaded before."""

import subprocess
import sys

import numpy as np
import pytest

from p2l.team import facility, plan, solve_facility_location
from p2l.team.facility import location, program, solve
from tests.team.team_instances import geometric

# Two routes to one optimum leave different multipliers, so equal bytes mean an equal route.
ANSWERS = """
import hashlib, sys
import numpy as np
from p2l.team import plan, solve_facility_location
from tests.team.team_instances import geometric
if "kernels" in sys.argv:
    from p2l.team.facility.solve import load_kernels
    load_kernels()
def answer(cost, bound, status, certificate):
    print(cost, bound, status, hashlib.sha256(certificate.multipliers.tobytes()).hexdigest())
def planner():
    for n in (20, 40, 41, 60, 150):
        result = plan(geometric(n))
        answer(result.objective, result.lower_bound, result.status, result.certificate)
def location():
    for size in (8, 25, 30, 50):
        rng = np.random.default_rng(size)
        result = solve_facility_location(rng.uniform(1.0, 9.0, size), rng.uniform(1.0, 9.0, (size, size)))
        answer(result.cost, result.lower_bound, result.status, result.certificate)
{"planner": planner, "location": location}[sys.argv[1]]()
"""


def answers(*arguments):
    run = subprocess.run([sys.executable, "-c", ANSWERS, *arguments], capture_output=True, text=True, check=True)
    return run.stdout


def spies(monkeypatch, *places):
    """A list that grows by the name of each function of `places` that is called."""
    calls = []
    for module, name in places:
        monkeypatch.setattr(module, name, spy(calls, name, getattr(module, name)))
    return calls


def spy(calls, name, function):
    def call(*arguments, **options):
        calls.append(name)
        return function(*arguments, **options)

    return call


@pytest.mark.parametrize("solver", ["planner", "location"])
def test_loading_the_kernels_changes_no_answer(solver):
    assert answers(solver) == answers(solver, "kernels")


@pytest.mark.parametrize(("n", "route"), [(1, "solve_program"), (40, "solve_program"), (41, "solve_pairs")])
def test_the_number_of_tasks_decides_who_plans(n, route, monkeypatch):
    calls = spies(monkeypatch, (program, "solve_program"), (solve, "solve_pairs"))
    assert plan(geometric(n)).status == "optimal"
    assert calls == [route]


@pytest.mark.parametrize(("more", "route"), [(0, "solve_program"), (1, "solve_pairs")])
def test_the_number_of_pairs_decides_who_locates(more, route, monkeypatch):
    rng = np.random.default_rng(0)
    opening, service = rng.uniform(1.0, 9.0, 12), rng.uniform(1.0, 9.0, (20, 12))
    monkeypatch.setattr(location, "FEW_PAIRS", len(facility.of_table(opening, service).cost) - more)
    calls = spies(monkeypatch, (program, "solve_program"), (solve, "solve_pairs"))
    assert solve_facility_location(opening, service).status == "optimal"
    assert calls == [route]


def test_a_small_instance_without_time_still_gets_a_solution_and_a_true_bound():
    rng = np.random.default_rng(3)
    opening, service = rng.uniform(10.0, 20.0, 25), rng.uniform(1.0, 9.0, (25, 25))
    early = solve_facility_location(opening, service, time_limit_s=1e-9)
    best = solve_facility_location(opening, service)
    assert early.status == "time_limit"
    assert early.lower_bound <= best.cost <= early.cost


def test_the_door_opens_on_every_name_it_lists():
    assert all(callable(getattr(facility, name)) for name in facility.__all__)
    with pytest.raises(AttributeError, match="no attribute 'simplex'"):
        _ = facility.simplex
