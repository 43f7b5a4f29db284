"""Primitive actions: where a motion starts, and what that spares a thing that is pressed against something."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from p2l import make_world
from p2l.contracts.observation import Observation
from p2l.skills import chain
from p2l.skills.primitives import (
    FROM_HAND,
    GRIPS,
    MOVE_STEPS,
    PRIMITIVES,
    STEPS,
    TRANSLATION_M,
    grips_beside,
    of_version,
)
from p2l.skills.runner import Reason, open_runner

UP = [0.0, 1.0, 0.0, 0.0]  # of a hand whose fingers point down
BY_NAME = {each.name: each for each in PRIMITIVES}


def seen(ahead_m):
    """A hand at the origin that is asked to be `ahead_m` farther along y."""
    return Observation.of(
        {
            "grip_pos_m": np.zeros((1, 3)),
            "target_pos_m": np.array([[0.0, ahead_m, 0.0]]),
            "target_quat": np.array([UP]),
            "grip_command": np.ones((1, 1)),
        }
    )


def commands(primitive, observation):
    """[STEPS, 3] positions that it asks for."""
    memory, asked = primitive.begin(observation), []
    for step in range(STEPS):
        decided = primitive.decide(observation, memory, np.array([step]))
        asked.append(decided.command.values[0, :3])
        memory = decided.memory
    return np.array(asked)


@pytest.mark.parametrize("ahead_m", [0.0, 0.045])
def test_a_motion_starts_where_the_hand_is(ahead_m):
    back = BY_NAME["move +y"]  # of a hand that looks down, backwards in the world
    asked = commands(back, seen(ahead_m))
    steps = np.minimum(np.arange(1, STEPS + 1) / MOVE_STEPS, 1.0)
    assert_allclose(asked, steps[:, None] * [0.0, -TRANSLATION_M, 0.0], atol=1e-12)
    older = commands(of_version(FROM_HAND - 1)[PRIMITIVES.index(back)], seen(ahead_m))
    assert_allclose(older[-1], asked[-1], atol=1e-12)
    assert (older[0, 1] > 0.0) == (ahead_m > 0.0), "a hand that is stopped went on pressing"


def test_the_primitives_of_a_world_are_those_of_its_version():
    for version in (2, 3):
        world = make_world("shelf", {"version": version, "nthread": 1})
        assert world.version == version
        assert world.primitives() == of_version(version)
        assert {each.from_hand for each in (*world.primitives(), *grips_beside(world.primitives()))} == {version == 3}
    assert grips_beside(PRIMITIVES) == GRIPS
    assert make_world("pick_place", {"nthread": 1}).primitives() == PRIMITIVES


def test_what_is_pressed_against_something_is_spared_by_the_first_motion():
    """On another arm, whose hand does not yield, a thing slipped while the first motion still pressed."""
    params = {"arm": "UR5e", "sigma_m": [0.0, 0.0], "shelf_sigma_m": [0.0, 0.01, 0.02], "models": 2, "nthread": 1}
    flagged = {}
    for version in (2, 3):
        world = make_world("shelf", {**params, "version": version})
        last = chain.run(world, world.nominal_options(), world.sample(np.random.default_rng(5), 64)).last
        rows = last.take(last.reason == Reason.FAILURE).rows
        runner, every = open_runner(world, world.primitives(), len(rows)), np.arange(len(rows))
        runner.place(every, rows, muted=True)
        runner.begin(every, np.full(len(rows), PRIMITIVES.index(BY_NAME["move -y"])))
        ended = flags = 0
        while ended < len(rows):
            events = runner.advance()
            ended, flags = ended + len(events.slot), flags + int((events.reason == Reason.FAILURE).sum())
        flagged[version] = flags / len(rows)
    assert flagged[3] < 0.6 * flagged[2]
