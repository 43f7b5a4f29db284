"""Plans for an uncertain tomorrow against every plan there is, laws, and cases computed by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from shop_instances import large_shop
from two_stage_instances import large_program, of_shop, one_scenario, small_program

from p2l.errors import ConfigError, ShapeError, SolverError
from p2l.team import Problem
from p2l.team.shop import Shop, plan_shop
from p2l.team.tomorrow import TwoStage, check_two_stage_plan, plan_two_stage, recourse, two_stage_outcome
from p2l.team.tomorrow.oracle import every_two_stage_plan


@pytest.mark.parametrize(
    ("order", "commit"), [("fixed", "today"), ("any", "today"), ("partial", "today"), ("any", "all"), ("fixed", "all")]
)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_no_plan_of_a_small_tomorrow_is_better(order, commit, seed):
    program = small_program(np.random.default_rng(seed), order, commit)
    try:
        best = every_two_stage_plan(program)[0]
    except SolverError:
        with pytest.raises(ConfigError, match="no plan keeps today's limits"):
            plan_two_stage(program)
        return
    day = plan_two_stage(program)
    verdict = check_two_stage_plan(program, day)
    assert day.status == "optimal"
    assert_allclose([day.objective, verdict.bound], best, rtol=2e-9, atol=1e-9)
    _, tomorrow = recourse(program, day.taught)
    assert_allclose(day.today.objective + program.probability @ tomorrow, best, rtol=2e-9, atol=1e-9)
