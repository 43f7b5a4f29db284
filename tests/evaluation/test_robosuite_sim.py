"""robosuite's environments behind the contract of a world: the same scene, its own verdict, options unchanged."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from p2l import registry
from p2l.errors import ConfigError
from p2l.evaluation import robosuite_sim
from p2l.evaluation.robosuite_sim.gains import inertia, matched
from p2l.sim.scene import WRIST_FORCE
from p2l.skills import chain
from p2l.skills.primitives import PRIMITIVES
from p2l.worlds.world import World
from tests.worlds.push import Push

SIDE = {"x_m": [0.0, 0.02], "y_m": [-0.193, 0.193]}


@pytest.fixture(scope="module")
def bread():
    world = registry.get_world("pick_place", SIDE)
    transfer = robosuite_sim.make(world)
    yield world, transfer
    transfer.engine.close()


def same_readings(world, transfer, rows):
    """Our sensors in our engine and in robosuite's simulation, force left out."""
    poses_only = np.ones(rows.sensors.shape[1], dtype=bool)
    poses_only[world.engine.sensor_columns[WRIST_FORCE]] = False
    for index in range(len(rows)):
        row = rows.take([index])
        control = np.zeros((1, len(world.engine.control_names)))
        theirs = transfer.engine.sense(row.states, control, row.model)
        sign = np.sign(theirs * row.sensors)  # a rotation has two quaternions
        assert_allclose(np.abs(theirs[:, poses_only]), np.abs(row.sensors[:, poses_only]), atol=1e-6)
        assert (sign[:, world.engine.sensor_columns["grip_pos"]] > 0).all()


def test_a_row_is_the_same_place_in_both_simulations(bread):
    world, transfer = bread
    assert isinstance(transfer, World)
    same_readings(world, transfer, world.sample(np.random.default_rng(0), 3))
    door = registry.get_world("door")
    other = robosuite_sim.make(door)
    same_readings(door, other, door.sample(np.random.default_rng(0), 3))
    other.engine.close()


def test_our_goal_is_their_verdict(bread):
    world, transfer = bread
    rng = np.random.default_rng(4)
    rows = world.sample(rng, 80)
    states = rows.states.copy()
    states[:, 1 + world._bread_at : 4 + world._bread_at] = rng.uniform([0.05, -0.02, 0.78], [0.35, 0.32, 0.92], (80, 3))
    hand = world.read(rows, "grip_pos")[:10]
    states[:10, 1 + world._bread_at : 4 + world._bread_at] = hand + 0.03
    control = np.zeros((80, len(world.engine.control_names)))
    rows = replace(rows, states=states, sensors=world.engine.sense(states, control, rows.model))
    verdicts = []
    for index in range(80):
        transfer.engine.sense(states[[index]], control[[index]], rows.model[[index]])
        verdicts.append(transfer.engine.success())
    assert 0 < sum(verdicts) < 80
    assert world.goal(rows).tolist() == verdicts


def test_options_run_unchanged_and_end_as_in_our_world(bread):
    world, transfer = bread
    rows = world.sample(np.random.default_rng(5), 6)
    room = world.privileged(rows)["hand_room_m"][:, 0]
    rows = rows.take([np.argmax(room), np.argmin(room)])  # one bread in the middle, one at a wall
    options = registry.get_options("pick_place", world)
    ours, theirs = chain.run(world, options, rows), robosuite_sim.execute(transfer, options, rows)
    assert theirs.success.tolist() == ours.success.tolist() == [True, False]
    assert [world.failure_kinds[kind] for kind in theirs.last.kind if kind >= 0] == ["collision"]
    assert transfer.observe(theirs.last.rows).names == world.observe(ours.last.rows).names
    assert transfer.privileged(theirs.last.rows).names == world.privileged(ours.last.rows).names

    failure = ours.last.rows.take([1])  # recorded in our world, recovered from in robosuite's
    moves = {move.name: index for index, move in enumerate(PRIMITIVES, start=len(options))}
    plan = [moves["move -z"], moves["move -z"], moves["turn +z"], *range(len(options))]
    taken = iter([*plan[1:], chain.FINISH])
    saved = robosuite_sim.execute(
        transfer,
        [*options, *PRIMITIVES],
        failure,
        first=np.array(plan[:1]),
        choose=lambda ended: np.array([next(taken)]),
        stop_on_failure=False,
    )
    assert saved.success.all()


def test_one_row_at_a_time(bread):
    world, transfer = bread
    rows = transfer.sample(np.random.default_rng(0), 2)
    with pytest.raises(ConfigError, match="one row at a time, got 2"):
        chain.run(transfer, registry.get_options("pick_place", world), rows, slots=2)


def test_matched_gains_give_the_stiffness_and_the_damping(bread):
    world, _ = bread
    scene = world.scenes[0]
    qpos = world.engine.qpos(world.sample(np.random.default_rng(0), 1).states)[0]
    gains, kept = matched(scene, qpos), scene.physics
    for axis, mass, stiffness, damping in zip(
        (0, 3),
        inertia(scene, qpos),
        (kept.stiffness_linear, kept.stiffness_angular),
        (kept.damping_linear, kept.damping_angular),
        strict=True,
    ):
        mean = np.exp(np.log(np.linalg.eigvalsh(mass)).mean())
        assert_allclose(gains.kp[axis] * mean, stiffness)
        assert_allclose(2 * gains.damping_ratio[axis] * np.sqrt(gains.kp[axis]) * mean, damping)


def test_what_robosuite_does_not_have_is_refused(bread):
    world, _ = bread
    with pytest.raises(ConfigError, match="no task of its own for 'push'; it has: door, pick_place"):
        robosuite_sim.make(Push())
    with pytest.raises(ConfigError, match=r"Door \(with the Panda\) differs from this world in Door_handle"):
        robosuite_sim.make(registry.get_world("door", {"handle": "5"}))
    with pytest.raises(ConfigError, match="unknown tuning 'soft'; known: matched, own"):
        robosuite_sim.make(world, tuning="soft")
