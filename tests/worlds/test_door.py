"""The door: what it tells of a grasp, when it flags, which ranges it refuses, and that its chain opens it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from p2l.contracts.rows import Command
from p2l.errors import ConfigError
from p2l.skills import chain
from p2l.worlds.door.handles import DOOR, HANDLES, axis_of, find, grasp_pose, hinge_of
from p2l.worlds.door.world import FORCE, MISSED_HANDLE, OPEN_RAD, SLIP_PULLING, Door


@pytest.fixture(scope="module")
def world():
    return Door(estimator="exact")


@pytest.fixture(scope="module")
def opened(world):
    """The ends of the three options from 24 starts, with the exact state."""
    rows = world.sample(np.random.default_rng(3), 24)
    return chain.run(world, world.nominal_options(), rows, stop_on_failure=False)


def hold(world, rows, grip):
    pose = rows.states[:, world.engine.physics_size : world.engine.physics_size + 7].copy()
    return Command.pose(pose[:, :3], pose[:, 3:], np.full(len(rows), grip))


def test_the_chain_opens_the_door_and_each_precondition_holds_in_turn(world, opened):
    assert opened.success.mean() > 0.95
    options = world.nominal_options()
    for ended, following in ((0, 1), (1, 2)):
        truth = world.privileged(opened.ends.take(opened.ends.option == ended).rows)
        assert options[following].precondition(truth).mean() > 0.9
        assert not options[0].precondition(truth).any(), "the hand is at the handle"
    assert (world.joint(opened.last.rows, "Door_hinge")[opened.success] >= OPEN_RAD).all()


def test_geometry_of_the_nominal_door_is_robosuites(world):
    rows = world.sample(np.random.default_rng(1), 5)
    model = world.scenes[0].model
    pos, quat = world.read(rows, "handle_pos"), world.read(rows, "handle_quat")
    furniture = world.furniture(rows, "Door_main")
    # At rest the hinge is 0.43 m from the handle's axis along the door, and both lie in its middle plane.
    assert_allclose(np.linalg.norm(hinge_of(pos, quat) - axis_of(pos, quat), axis=1), np.hypot(0.43, 0.10), atol=1e-9)
    door, latch = model.body("Door_door"), model.body("Door_latch")
    assert_allclose(model.joint("Door_hinge").pos[0] - latch.pos[0], 0.43)
    assert_allclose(axis_of(pos, quat)[:, 2], furniture[:, 2] + door.pos[2] + latch.pos[2], atol=1e-6)
    _, hand, into = grasp_pose(pos, quat, 1.0)
    assert_allclose(into[:, 2], 0.0, atol=1e-6)
    assert_allclose(np.linalg.norm(hand, axis=1), 1.0)


def test_closing_on_nothing_is_flagged_once(world):
    rows = world.sample(np.random.default_rng(2), 3)
    kinds = []
    for _ in range(9):
        rows, kind, _ = world.advance(rows, hold(world, rows, 1.0))
        kinds.append(kind)
    flagged = np.array(kinds) == MISSED_HANDLE
    assert_array_equal(flagged.sum(axis=0), 1)
    assert not world.in_grip(rows).any()
    rows, kind, _ = world.advance(rows, hold(world, rows, 0.0))
    assert not rows.memory.any(), "opening the fingers starts afresh"


def test_letting_the_handle_slip_while_pulling_is_flagged(world, opened):
    rows = opened.ends.take(opened.ends.option == 0).rows
    assert world.in_grip(rows).all()
    back = -grasp_pose(world.read(rows, "handle_pos"), world.read(rows, "handle_quat"), 1.0)[2]
    seen = set()
    for _ in range(14):  # the latch is still in the frame, so the hand is drawn off the lever
        command = hold(world, rows, 1.0)
        rows, kind, _ = world.advance(rows, Command.pose(command.pos + 0.03 * back, command.quat, command.grip))
        seen |= set(kind.tolist())
    assert SLIP_PULLING in seen
    assert not world.in_grip(rows).any()


def test_pressing_hard_is_flagged_as_force():
    world = Door(estimator="exact", force_limit_n=1.0)
    rows = world.sample(np.random.default_rng(0), 2)
    _, kind, _ = world.advance(rows, hold(world, rows, 0.0))
    assert_array_equal(kind, FORCE)


@pytest.mark.parametrize(("handle", "springs_back", "shuts"), [("1", True, False), ("real", False, True)])
def test_a_lever_stays_where_it_was_left_on_the_real_door_alone(handle, springs_back, shuts):
    """The other one springs back, and the door stays where it is: a failure leaves nothing behind but an open crack."""
    world = Door(estimator="exact", handle=handle)

    def left(latch_rad, hinge_rad):
        rows = world.sample(np.random.default_rng(0), 4)
        states = rows.states.copy()
        states[:, world._columns[f"{DOOR}_latch_joint"]] = latch_rad
        states[:, world._columns[f"{DOOR}_hinge"]] = hinge_rad
        rows = replace(rows, states=states)
        for _ in range(60):
            rows, _, _ = world.advance(rows, hold(world, rows, 0.0))
        return world.joint(rows, f"{DOOR}_latch_joint"), world.joint(rows, f"{DOOR}_hinge")

    lever, _ = left(0.9, 0.0)
    assert (np.abs(lever) < 0.15).all() if springs_back else (lever > 0.8).all()
    _, ajar = left(1.3, 0.12)
    assert (ajar < 0.02).all() if shuts else (ajar > 0.1).all()


def test_a_door_without_later_fields_is_the_one_that_it_was():
    """Committed records and policies know it by its digest."""
    assert Door(estimator="fixed").digest == "b28bab3846107b3f"
    assert HANDLES["1"].identity == repr(HANDLES["1"])
    assert HANDLES["real"].identity != repr(HANDLES["real"])


def test_rows_of_one_batch_have_different_handles():
    world = Door(estimator="exact", handle=list(HANDLES))
    rows = world.sample(np.random.default_rng(0), 60)
    assert set(rows.model.tolist()) == set(range(len(HANDLES)))
    done = chain.run(world, world.nominal_options(), rows, stop_on_failure=False)
    assert done.success.mean() > 0.85


def test_bad_parameters_are_told_before_anything_runs():
    with pytest.raises(ConfigError, match=r"unknown handle 6; known handles: 1, 2, 3, 4, 5, real, full_size"):
        Door(handle="6")
    with pytest.raises(ConfigError, match=r"unknown arm 'Bender'; known arms: Panda"):
        Door(arm="Bender")
    with pytest.raises(ConfigError, match=r"yaw_rad must be \[low, high\] with low ≤ high, got \[0.3, 0.1\]"):
        Door(yaw_rad=(0.3, 0.1))
    with pytest.raises(ConfigError, match=r"no posture of the arm Panda.*0.8, 0.25.*narrow x_m"):
        Door(x_m=(0.4, 0.8))
    assert find([1, "5"]) == (HANDLES["1"], HANDLES["5"])
