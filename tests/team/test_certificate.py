import dataclasses

import numpy as np
import pytest

from p2l.errors import SolverError
from p2l.team import plan, solve_facility_location
from p2l.team.certificate import check_certificate, check_facility_location
from tests.team.team_instances import geometric

PROBLEM = geometric(50)
PLAN = plan(PROBLEM, "facility")


def with_certificate(result, **change):
    return dataclasses.replace(result, certificate=dataclasses.replace(result.certificate, **change))


def raised(v):
    higher = v.copy()
    higher[3] += 1.0
    return higher


@pytest.mark.parametrize("planner", ["highs", "facility", "greedy", "dual_ascent"])
def test_an_honest_certificate_passes(planner):
    result = plan(PROBLEM, planner)
    verdict = check_certificate(PROBLEM, result)
    assert verdict.cost == pytest.approx(result.objective)
    assert verdict.bound <= plan(PROBLEM).objective * (1 + 1e-9)
    assert verdict.gap == pytest.approx((result.objective - verdict.bound) / result.objective, abs=1e-12)


@pytest.mark.parametrize(
    ("tampered", "message"),
    [
        (with_certificate(PLAN, bound=PLAN.certificate.bound + 1.0), "certificate.bound"),
        (with_certificate(PLAN, multipliers=PLAN.certificate.multipliers * 0.9), "certificate.bound"),
        (with_certificate(PLAN, multipliers=raised(PROBLEM.outside)), "above its outside option"),
        (with_certificate(PLAN, multipliers=PLAN.certificate.multipliers[:-1]), "49 multipliers given"),
        (with_certificate(PLAN, cost=PLAN.objective - 1.0), "certificate.cost"),
        (dataclasses.replace(PLAN, objective=PLAN.objective - 1.0), "objective"),
        (dataclasses.replace(PLAN, lower_bound=PLAN.objective + 1.0), "exceeds the cost"),
        (dataclasses.replace(PLAN, decision=np.zeros(50, dtype=np.int64)), "expected_cost"),
        (dataclasses.replace(PLAN, expected_cost=PLAN.expected_cost[::-1].copy()), "expected_cost"),
        (dataclasses.replace(PLAN, certificate=None), "none given"),
    ],
)
def test_a_tampered_one_is_refused(tampered, message):
    with pytest.raises(SolverError, match=message):
        check_certificate(PROBLEM, tampered)


def test_a_certificate_of_another_problem_is_refused():
    with pytest.raises(SolverError, match="certificate"):
        check_certificate(geometric(50, seed=1), PLAN)


def test_the_certificate_of_a_facility_location_solution_is_checked_too():
    rng = np.random.default_rng(0)
    opening, service = rng.uniform(1, 9, 12), rng.uniform(1, 9, (20, 12))
    solution = solve_facility_location(opening, service)
    assert check_facility_location(opening, service, solution).gap < 0.2
    closed = dataclasses.replace(solution, open=~solution.open)
    with pytest.raises(SolverError, match="not open"):
        check_facility_location(opening, service, closed)
    with pytest.raises(SolverError, match="cost is"):
        check_facility_location(opening, service, dataclasses.replace(solution, cost=solution.cost - 1))
    lied = with_certificate(solution, bound=solution.certificate.bound + 1.0)
    with pytest.raises(SolverError, match=r"certificate.bound"):
        check_facility_location(opening, service, lied)
