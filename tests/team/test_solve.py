import time

import numpy as np
import pyomo.environ as pyo
import pytest

from p2l.errors import SolverError
from p2l.team.facility import of_problem, solve_program
from p2l.team.mip.model import lessons_of, max_form, strong_form
from p2l.team.mip.solve import solve_model
from tests.team.team_instances import thesis_set


def in_s(seconds):
    return time.perf_counter() + seconds


TRANSFER = np.triu(np.full((6, 6), 0.9))


@pytest.mark.parametrize("build", [max_form, strong_form])
@pytest.mark.parametrize("bad", [float("nan"), float("inf")])
def test_nan_and_infinity_never_reach_highs(build, bad):
    model = build(thesis_set(3, TRANSFER[:3, :3]))
    model.cost.expr += bad * model.x[1]
    with pytest.raises(SolverError, match="holds NaN or infinity"):
        solve_model(model, deadline=in_s(5.0))


@pytest.mark.parametrize("part", ["opening", "outside", "cost"])
def test_the_array_route_refuses_them_too(part):
    pairs = of_problem(thesis_set(6, TRANSFER))
    broken = getattr(pairs, part).copy()
    broken[1] = np.nan
    with pytest.raises(SolverError, match="a cost is NaN"):
        solve_program(pairs._replace(**{part: broken}), time_limit_s=5.0)


@pytest.mark.parametrize("build", [max_form, strong_form])
def test_an_extension_that_leaves_no_plan_is_said_to_be_infeasible(build):
    model = build(thesis_set(3))
    model.budget = pyo.Constraint(expr=sum(model.x[i] for i in model.tasks) >= 4)
    with pytest.raises(SolverError, match="no solution exists"):
        solve_model(model, deadline=in_s(5.0))


@pytest.mark.parametrize("build", [max_form, strong_form])
def test_a_model_can_be_extended_and_both_forms_still_agree(build):
    # without the budget the plan is one lesson on task 0; lessons may now only come from the second half
    problem = thesis_set(6, TRANSFER)
    model = build(problem)
    model.late = pyo.Constraint(expr=model.x[0] + model.x[1] + model.x[2] == 0)
    ending = solve_model(model, deadline=in_s(30.0))
    assert ending.complete
    scale = pyo.value(model.cost) / (3 * 100 + 200 + 2 * (10 + 10))
    assert np.log2(scale) == pytest.approx(round(np.log2(scale)))
    assert lessons_of(model).tolist() == [False, False, False, True, False, False]


def test_a_model_that_is_not_handed_over_in_time_says_so():
    with pytest.raises(TimeoutError):
        solve_model(strong_form(thesis_set(2)), deadline=in_s(-1.0))


@pytest.mark.parametrize("limit", [0.0, -1.0, float("nan")])
def test_a_time_limit_must_be_positive(limit):
    with pytest.raises(SolverError, match="must be above 0"):
        solve_program(of_problem(thesis_set(2)), time_limit_s=limit)
