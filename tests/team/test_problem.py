import dataclasses
import subprocess
import sys

import numpy as np
import pytest

from p2l.errors import ShapeError
from p2l.team import Decision, objective
from tests.team.team_instances import thesis_set


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"c_rob": np.array([1.0, np.nan])}, "c_rob: holds NaN"),
        ({"c_hum": np.full(2, np.inf), "c_rob": np.full(2, np.inf), "c_demo": np.full(2, np.inf)}, "cannot be done"),
        ({"tasks": "ab"}, "tasks: 'ab' given; expected a list of names"),
        ({"tasks": {"a", "b"}}, "expected a list of names, in work order"),
        ({"tasks": None}, "tasks: None given; expected a list of names"),
        ({"tasks": ("a", "\ud800")}, "is no name"),
        ({"c_rob": [1.0, [2.0]]}, "c_rob: its rows have different lengths"),
        ({"c_rob": ["1", "2"]}, "c_rob: holds <U1 values; expected numbers"),
        ({"c_rob": [10**400, 1]}, "c_rob: holds object values that are not numbers"),
        ({"c_rob": np.ma.masked_array([1.0, 2.0], [True, False])}, "c_rob: is masked"),
        ({"order": np.array(["any"])}, "order: "),
        ({"c_fail": np.array([1.0, -0.5])}, "c_fail: holds -0.5"),
        ({"c_demo": np.ones(3)}, "c_demo: axis 0 has length 3"),
        ({"c_demo": np.full(2, 1e308)}, "c_demo: holds 1e.308; expected values of at most 1e.100, or infinity"),
        ({"pretrained": np.array([0.0, 1.1])}, "pretrained: holds 1.1"),
        ({"transfer": np.zeros((2, 3))}, "transfer: axis 1 has length 3"),
        ({"transfer": np.full((2, 2), np.nan)}, "transfer: holds NaN"),
        ({"transfer": np.full((2, 2), -0.1)}, "transfer: holds -0.1"),
        ({"tasks": ("a", "a")}, "'a' appears more than once"),
        ({"tasks": ()}, "at least one task"),
        ({"order": "sorted"}, "order: 'sorted' is unknown"),
    ],
)
def test_a_bad_problem_is_refused_at_birth(change, message):
    with pytest.raises(ShapeError, match=message):
        dataclasses.replace(thesis_set(2), **change)


def test_arrays_of_a_problem_cannot_change_afterwards():
    with pytest.raises(ValueError, match="read-only"):
        thesis_set(2).c_rob[0] = np.nan


def test_expected_costs_by_hand():
    # the lesson on task 1 helps task 3 (0.8) and comes too late for task 0
    transfer = np.zeros((4, 4))
    transfer[1] = [0.9, 1.0, 0.3, 0.8]
    decision = np.array([Decision.ACT, Decision.LEARN, Decision.DELEGATE, Decision.ACT])
    outcome = objective(thesis_set(4, transfer, pretrained=0.5), decision)
    assert outcome.expected_cost == pytest.approx([10 + 50, 200, 100, 10 + 20])
    assert outcome.skill.tolist() == [-1, 1, -1, 1]
    assert outcome.p_success == pytest.approx([0.5, 1.0, 1.0, 0.8])


def test_with_a_free_order_a_lesson_helps_every_task():
    transfer = np.zeros((2, 2))
    transfer[1, 0] = 0.9
    problem = dataclasses.replace(thesis_set(2, transfer), order="any")
    decision = np.array([Decision.ACT, Decision.LEARN])
    assert objective(problem, decision).expected_cost == pytest.approx([20, 200])
    assert objective(problem, decision, np.array([0, 1])).expected_cost == pytest.approx([110, 200])


@pytest.mark.parametrize("sequence", [[0, 0], [1, 0]])
def test_a_sequence_must_be_a_permutation_and_keep_a_fixed_order(sequence):
    with pytest.raises(ShapeError, match="sequence"):
        objective(thesis_set(2), np.array([0, 0]), np.array(sequence))


def test_importing_the_room_loads_no_solver():
    code = (
        "import sys, p2l.team; print([m for m in ('numba', 'pyomo', 'highspy', 'scipy', 'pandas') if m in sys.modules])"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "[]"
