"""A time limit counts loading too: nobody waits longer for a solver than the limit allows."""

import subprocess
import sys
import threading

import numpy as np
import pytest

from p2l.team import loading, plan, solve_facility_location
from p2l.team.certificate import check_certificate
from p2l.team.facility import location, solve
from tests.team.team_instances import geometric


@pytest.fixture
def blocked_kernels(monkeypatch):
    """Kernels that are not loaded before the test ends, as on a fresh installation, where they are compiled."""
    released = threading.Event()
    loading._started.cache_clear()
    monkeypatch.setattr(solve, "load_kernels", released.wait)
    yield
    released.set()
    loading._started.cache_clear()


@pytest.mark.parametrize(("planner", "n"), [("auto", 60), ("facility", 9), ("greedy", 60), ("dual_ascent", 60)])
@pytest.mark.usefixtures("blocked_kernels")
def test_a_planner_does_not_wait_for_its_kernels(planner, n):
    """The first call of a process overran 0.05 s by half a second, on a fresh installation by fifteen."""
    problem = geometric(n)
    result = plan(problem, planner, time_limit_s=0.3)
    assert result.status in ("time_limit", "heuristic")
    check_certificate(problem, result)
    best = plan(problem, "highs")
    assert result.lower_bound <= best.objective <= result.objective < problem.c_hum.sum()


@pytest.mark.usefixtures("blocked_kernels")
def test_a_finished_search_without_kernels_for_its_proof_says_so():
    result = plan(geometric(9), "exhaustive", time_limit_s=0.5)
    assert result.objective == pytest.approx(plan(geometric(9), "highs").objective)
    assert result.status == "feasible"


@pytest.mark.usefixtures("blocked_kernels")
@pytest.mark.parametrize("usable", [True, False])
def test_facility_location_does_not_wait_for_its_kernels(monkeypatch, usable):
    monkeypatch.setattr(location, "FEW_PAIRS", 0)
    rng = np.random.default_rng(0)
    opening, service = rng.uniform(1.0, 9.0, 12), rng.uniform(1.0, 9.0, (12, 12))
    if not usable:
        opening[1:] = np.inf
    result = solve_facility_location(opening, service, time_limit_s=0.3)
    monkeypatch.undo()
    loading._started.cache_clear()
    best = solve_facility_location(opening, service)
    assert best.status == "optimal"
    assert result.lower_bound <= best.cost <= result.cost
    assert result.cost == pytest.approx(best.cost) or result.status == "time_limit"


def test_what_cannot_be_loaded_says_so_every_time():
    def broken():
        raise ImportError("no such solver")

    for _ in range(2):
        with pytest.raises(ImportError, match="no such solver"):
            loading.loaded(broken, float("inf"))


def test_a_process_ends_while_something_is_being_loaded():
    code = """
import threading, time
from p2l.team.loading import loaded
try:
    loaded(threading.Event().wait, time.perf_counter() + 0.1)
except TimeoutError:
    print("gone on")
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600)
    assert (run.returncode, run.stdout, run.stderr) == (0, "gone on\n", "")
