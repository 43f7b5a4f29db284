"""What the wrist has felt, and where hand, thing and target are to one another: version 2 of the worlds."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from p2l import make_world
from p2l.contracts.world import NO_FAILURE
from p2l.skills import chain
from p2l.worlds.felt import FELT_SIZE, LEVEL_N, felt_force


def test_the_sequence_by_hand():
    past = np.arange(FELT_SIZE, dtype=float)[None]
    now = felt_force(past, np.array([[-2.5 * LEVEL_N, 0.9 * LEVEL_N, 100.0 * LEVEL_N]]))
    assert_array_equal(now[0, :3], [-2.0, 0.0, 3.0])
    assert_array_equal(now[0, 3:], past[0, :-3])


@pytest.fixture(scope="module")
def failures():
    """The shelf's, of version 2."""
    world = make_world("shelf", {"version": 2, "models": 2, "nthread": 1})
    last = chain.run(world, world.nominal_options(), world.sample(np.random.default_rng(0), 24)).last
    return world, last.take(last.kind != NO_FAILURE)


def test_a_failure_keeps_what_was_felt_before_it(failures):
    """A collision presses on the wrist at its flag, and not yet at the oldest moment that is kept of all."""
    world, last = failures
    collided = last.kind == world.failure_kinds.index("collision")
    assert collided.any()
    felt = world.observe(last.rows)["felt_force"].reshape(len(last.rows), -1, 3)
    strength = np.abs(felt).max(axis=2)
    assert (strength[collided, 0] >= 2.0).all()
    assert (strength[collided, -1] < strength[collided, 0]).any()


def test_relative_positions_are_those_of_what_is_seen(failures):
    world, last = failures
    seen = world.observe(last.rows)
    assert_allclose(seen["hand_to_shelf_m"], seen["shelf_pos_m"] - seen["grip_pos_m"])
    assert_allclose(seen["hand_to_target_m"], seen["target_pos_m"] - seen["grip_pos_m"])
    above = seen["object_pos_m"][:, 2] - world.thing.bottom_m - seen["shelf_pos_m"][:, 2]
    assert_allclose(seen["bottom_above_floor_m"][:, 0], above)


@pytest.mark.parametrize("name", ["shelf", "pick_place"])
def test_the_first_version_sees_what_it_saw(name):
    fields = [
        set(world.observe(world.sample(np.random.default_rng(0), 1)).columns)
        for world in (make_world(name, {"version": version, "nthread": 1}) for version in (1, 2))
    ]
    assert fields[0] < fields[1]
    assert {"felt_force", "hand_to_target_m"} <= fields[1] - fields[0]
