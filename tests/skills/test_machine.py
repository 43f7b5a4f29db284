"""State machines as options: pace, change of phase, and that a row's way depends on nothing but what it sees."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from p2l import poses
from p2l.contracts.observation import Observation
from p2l.contracts.option import Option
from p2l.skills.machine import Machine, Phase, link

UNIT = np.array([1.0, 0.0, 0.0, 0.0])


def see(pos, target, gap=0.08, quat=UNIT, target_quat=UNIT):
    rows = len(np.atleast_2d(pos))
    wide = {"grip_quat": quat, "target_quat": target_quat}
    return Observation.of(
        {"grip_pos_m": np.atleast_2d(pos), "target_pos_m": np.atleast_2d(target), "gap_m": np.full(rows, gap)}
        | {name: np.tile(value, (rows, 1)) for name, value in wide.items()}
    )


def machine(enter=None):
    return Machine(
        "there and shut",
        (
            Phase(lambda observation: np.tile([1.0, 0.0, 0.0], (len(observation), 1)), grip=0.0, limit=4, pace_m=0.3),
            Phase(
                lambda observation: observation["target_pos_m"],
                grip=1.0,
                still_m=1e-3,
                reached_m=np.inf,
                at_least=2,
                limit=6,
            ),
        ),
        orient=lambda observation: np.tile(UNIT, (len(observation), 1)),
        ready=lambda truth: np.ones(len(truth), dtype=bool),
        enter=enter,
    )


def decide(option, observation, memory):
    return option.decide(observation, memory, np.zeros(len(observation), dtype=np.int64))


def test_the_target_goes_straight_at_its_pace_and_stops_at_the_goal():
    option = machine()
    observation = see([0.0, 0.0, 0.0], [0.4, 0.8, 0.0])
    moved = decide(option, observation, option.begin(observation)).command
    assert_allclose(moved.pos, [[0.4 + 0.3 * 0.6, 0.8 - 0.3 * 0.8, 0.0]])
    near = see([0.0, 0.0, 0.0], [0.9, 0.0, 0.0])
    assert_allclose(decide(option, near, option.begin(near)).command.pos, [[1.0, 0.0, 0.0]])
    turned = poses.quat(poses.about([0.0, 0.0, 1.0], 1.0))[0]
    far = see([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], target_quat=turned)
    after = poses.rotation(decide(option, far, option.begin(far)).command.quat).magnitude()
    assert_allclose(after, 1.0 - option.pace_rad)


def test_a_phase_ends_when_its_goal_is_reached_or_its_time_is_over():
    option = machine()
    there, away = see([1.0, 0.0, 0.0], [1.0, 0.0, 0.0]), see([0.0, 0.0, 0.0], [1.0, 0.0, 0.0])
    assert decide(option, there, option.begin(there)).command.grip == 1.0
    tilted = see([1.0, 0.0, 0.0], [1.0, 0.0, 0.0], quat=poses.quat(poses.about([1.0, 0.0, 0.0], 0.5))[0])
    assert decide(option, tilted, option.begin(tilted)).command.grip == 0.0, "not before it is turned right"
    memory, grips = option.begin(away), []
    for _ in range(6):
        decision = decide(option, away, memory)
        memory = decision.memory
        grips.append(float(decision.command.grip[0]))
    assert grips == [0.0] * 4 + [1.0] * 2


def test_fingers_must_have_come_to_rest():
    option = machine(enter=lambda observation: np.ones(len(observation), dtype=np.int64))
    gaps, done = [0.08, 0.06, 0.05, 0.0495, 0.0495], []
    memory = option.begin(see([0.0] * 3, [0.0] * 3))
    for gap in gaps:
        decision = decide(option, see([0.0] * 3, [0.0] * 3, gap=gap), memory)
        memory = decision.memory
        done.append(bool(decision.done[0]))
    assert done == [False, False, False, True, True]


@pytest.mark.parametrize("order", [[0, 1, 2], [2, 0, 1]])
def test_rows_do_not_touch_each_other(order):
    option = machine()
    assert isinstance(option, Option)
    pos = np.array([[1.0, 0.0, 0.0], [0.0, 0.5, 0.0], [0.2, 0.0, 0.1]])
    observation = see(pos, pos)
    whole = decide(option, observation, option.begin(observation))
    part = decide(option, observation.take(order), option.begin(observation.take(order)))
    assert_array_equal(part.command.pos, whole.command.pos[order])
    assert_array_equal(part.memory, whole.memory[order])


def test_linked_machines_decide_together_what_each_decides_alone():
    """The second begins in its second phase; each ends where its own phases do."""
    alone = (machine(), machine(enter=lambda observation: np.ones(len(observation), dtype=np.int64)))
    first, second = link(alone)
    assert first.decides_as == second.decides_as
    pos = np.array([[0.0, 0.0, 0.0], [0.0, 0.5, 0.0]])
    observation = see(pos, pos)
    parts = [observation.take([0]), observation.take([1])]
    own = [one.begin(part) for one, part in zip(alone, parts, strict=True)]
    together = np.concatenate([one.begin(part) for one, part in zip((first, second), parts, strict=True)])
    ends = []
    for _ in range(11):
        decisions = [decide(one, part, memory) for one, part, memory in zip(alone, parts, own, strict=True)]
        both = decide(first, observation, together)
        for row, decision in enumerate(decisions):
            assert_array_equal(both.command.pos[row], decision.command.pos[0])
            assert_array_equal(both.command.quat[row], decision.command.quat[0])
            assert both.command.grip[row] == decision.command.grip[0]
            assert both.done[row] == decision.done[0]
        ends.append(both.done.tolist())
        own, together = [decision.memory for decision in decisions], both.memory
    assert np.argmax(ends, axis=0).tolist() == [6, 2], "four steps and two at rest; two at rest"
