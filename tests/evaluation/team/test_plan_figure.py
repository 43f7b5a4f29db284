import dataclasses

import numpy as np
import pytest
from matplotlib.collections import LineCollection

from p2l.evaluation.team.plan import plan_figure, save_plan_figure
from p2l.team import Problem, plan


def problem(n):
    place = np.random.default_rng(n).random((n, 2))
    distance = np.linalg.norm(place[:, None] - place[None], axis=2)
    costs = [np.full(n, c) for c in (10.0, 100.0, 100.0, 200.0)]
    return Problem(tuple(f"task {i}" for i in range(n)), *costs, np.zeros(n), np.exp(-distance / 0.3))


@pytest.mark.parametrize("n", [1, 3, 20, 61])
@pytest.mark.parametrize("order", ["fixed", "any"])
def test_one_arc_runs_from_each_lesson_to_each_task_it_pays_for(n, order):
    given = dataclasses.replace(problem(n), order=order)
    made = plan(given)
    figure = plan_figure(given, made)
    above, below = figure.axes
    (arcs,) = [artist for artist in above.collections if isinstance(artist, LineCollection)]
    served = (made.decision == 0) & (made.skill >= 0)
    assert len(arcs.get_segments()) == served.sum()
    place = np.argsort(made.sequence) + 1
    ends = {(round(s[0, 0]), round(s[-1, 0])) for s in arcs.get_segments()}
    assert ends == {(place[made.skill[i]], place[i]) for i in np.flatnonzero(served)}
    tops = [patch.get_y() + patch.get_height() for patch in below.patches]
    assert max(tops) == pytest.approx(made.expected_cost.max())
    assert "unit" in below.get_ylabel()


def test_a_figure_is_written_whole(tmp_path):
    given = problem(8)
    save_plan_figure(tmp_path / "plan.png", given, plan(given))
    assert (tmp_path / "plan.png").read_bytes().startswith(b"\x89PNG")
    assert [path.name for path in tmp_path.iterdir()] == ["plan.png"]


def test_a_name_that_looks_like_a_formula_or_has_no_glyph_is_drawn_as_it_is(tmp_path, recwarn):
    given = dataclasses.replace(problem(3), tasks=("$5_{$", "$\\frac$", "杯子"))
    save_plan_figure(tmp_path / "plan.png", given, plan(given))
    assert (tmp_path / "plan.png").read_bytes().startswith(b"\x89PNG")
    assert not [warning for warning in recwarn if "Glyph" in str(warning.message)]
