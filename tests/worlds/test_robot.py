"""What every world with an arm shares."""

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
