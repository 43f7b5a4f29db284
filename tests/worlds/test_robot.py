"""What every world with an arm shares."""

import dataclasses

import numpy as np
import pytest

from p2l.errors import ConfigError
from p2l.worlds.table import make_world


def test_a_free_joint_is_no_number():
    """It silently gave the first of its seven columns."""
    world = make_world("pick_place", {"nthread": 1})
    rows = world.sample(np.random.default_rng(0), 2)
    free = next(name for name in world._columns if name not in world._single)
    with pytest.raises(ConfigError, match=f"joint '{free}' is free or a ball, its position is no number; read a pose"):
        world.joint(rows, free)
    with pytest.raises(ConfigError, match="no hinge or slide joint 'knee'; there are: "):
        world.joint(rows, "knee")


@pytest.mark.parametrize("name", ["cluttered_shelf", "pick_place", "shelf"])
def test_an_orientation_is_observed_alike_whatever_its_sign(name):
    """robosuite commands −q where our engine commands q: a policy that had never seen it went on and on."""
    world = make_world(name, {"nthread": 1})
    rows = world.sample(np.random.default_rng(0), 4)
    states, sensors = rows.states.copy(), rows.sensors.copy()
    place = world.engine.physics_size
    states[:, place + 3 : place + 7] *= -1.0
    sensors[:, world.engine.sensor_columns["grip_quat"]] *= -1.0
    seen, again = (world.observe(each) for each in (rows, dataclasses.replace(rows, states=states, sensors=sensors)))
    for field in ("grip_quat", "target_quat"):
        np.testing.assert_array_equal(again[field], seen[field])
