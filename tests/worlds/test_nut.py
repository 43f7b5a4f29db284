"""The nut: its chain puts it on the peg, what a failure did to it stays, and its symbols are where the hand is."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from p2l import poses
from p2l.contracts.rows import Command
from p2l.errors import ConfigError
from p2l.skills import chain
from p2l.worlds.nut.geometry import HOLE_HALF_M, NUT_HALF_M, PEG_HALF_M, PEG_TOP_M, TABLE_M, grasp_pose, yaw_off
from p2l.worlds.nut.skills import LEVEL
from p2l.worlds.nut.world import KINDS, Nut


@pytest.fixture(scope="module")
def world():
    return Nut(estimator="exact")


@pytest.fixture(scope="module")
def threaded(world):
    """The ends of the four options from 24 starts, with the exact state."""
    rows = world.sample(np.random.default_rng(3), 24)
    return chain.run(world, world.nominal_options(), rows, stop_on_failure=False)


@pytest.fixture(scope="module")
def failed():
    """A world whose peg is somewhere else than it seems, and its episodes."""
    world = Nut(sigma_m=(0.0, 0.02))
    rows = world.sample(np.random.default_rng(4), 24)
    return world, chain.run(world, world.nominal_options(), rows, stop_on_failure=False)


def hold(world, rows, grip):
    pose = world.target(rows).copy()
    return Command.pose(pose[:, :3], pose[:, 3:], np.full(len(rows), grip))


def test_the_chain_threads_the_nut_and_each_precondition_holds_in_turn(world, threaded):
    assert threaded.success.mean() > 0.95
    options = world.nominal_options()
    assert options[0].precondition(world.privileged(world.sample(np.random.default_rng(0), 8))).all()
    for ended in range(3):
        truth = world.privileged(threaded.ends.take(threaded.ends.option == ended).rows)
        assert options[ended + 1].precondition(truth).mean() > 0.9, options[ended + 1].name
        assert not options[0].precondition(truth).any(), "the nut is in the hand"
    assert (threaded.last.kind == -1).all()


def test_geometry_is_robosuites(world):
    model = world.scenes[0].model
    peg = [geom for geom in range(model.ngeom) if model.body(model.geom_bodyid[geom]).name == "peg1"]
    assert_allclose(model.geom_size[peg[0]][:2], PEG_HALF_M)
    assert_allclose(0.85 + model.geom_size[peg[0]][2], PEG_TOP_M)
    ring = [i for i in range(model.ngeom) if model.geom(i).name.startswith("SquareNut")][:4]
    inner = [abs(model.geom_pos[i][:2]).max() - model.geom_size[i][:2].min() for i in ring]
    assert_allclose(inner, HOLE_HALF_M, atol=1e-6)


def test_what_a_failure_did_to_the_nut_stays(failed):
    world, execution = failed
    lowered = execution.ends.take(execution.ends.option == 2)
    tilted = world.privileged(lowered.rows)["nut_up"][:, 2] < np.cos(0.3)
    rows = lowered.rows.take(tilted)
    assert len(rows) > 3, "the nut met the peg's edge and turned in the fingers"
    pose = world.target(rows).copy()
    pose[:, 2] += 0.15
    for _ in range(30):
        rows, _, _ = world.advance(rows, Command.pose(pose[:, :3], pose[:, 3:], np.ones(len(rows))))
    lifted = world.privileged(rows)
    held = lifted["held"][:, 0] > 0.0
    assert held.mean() > 0.6, "most are still in the fingers"
    assert (lifted["nut_up"][held, 2] < LEVEL).mean() > 0.8, "to lift it off the peg does not turn it back"


def test_detectors_tell_a_missed_nut_and_one_that_is_lost(world, threaded):
    rows, kinds = world.sample(np.random.default_rng(2), 3), []
    for _ in range(8):
        rows, kind, _ = world.advance(rows, hold(world, rows, 1.0))
        kinds.append(kind)
    assert (np.array(kinds) == KINDS.index("missed_nut")).sum(axis=0).tolist() == [1, 1, 1]
    carried = threaded.ends.take(threaded.ends.option == 1).rows
    assert not world.in_grip(world.sample(np.random.default_rng(2), 3)).any()
    assert world.in_grip(carried).all()


def test_symbols_say_where_the_hand_is(world, threaded):
    symbols = world.symbols()
    for ended, closed in ((0, True), (1, True), (2, True), (3, False)):
        rows = threaded.ends.take(threaded.ends.option == ended).rows
        truth = world.privileged(rows)
        state = symbols.state(truth)
        assert state.shape == (len(rows), len(symbols.names))
        assert (symbols.fingers_closed(state) == closed).all()
        pos, quat = symbols.hand(truth, state)
        assert_allclose(pos, truth["grip_pos_m"], atol=3e-3)  # a nut in the hand is laid flat where it lies
        assert (poses.angle(quat, truth["grip_quat"]) < 0.06).all()


def test_a_nut_at_the_peg_is_moved_to_where_the_state_has_it_and_one_elsewhere_stays(world, threaded):
    symbols, start = world.symbols(), world.sample(np.random.default_rng(5), 6)
    truth = world.privileged(start)
    over = symbols.state(world.privileged(threaded.ends.take(threaded.ends.option == 1).rows))[:6]
    pos, _ = symbols.hand(truth, over)
    assert_allclose(np.linalg.norm(pos[:, :2] - truth["peg_pos_m"][:, :2], axis=1), 0.058, atol=0.01)
    assert (pos[:, 2] > PEG_TOP_M).all()
    other = np.roll(symbols.state(truth), 1, axis=0)  # of another nut, which lies elsewhere
    pos, _ = symbols.hand(truth, other)
    grasp, _ = grasp_pose(truth["nut_pos_m"], truth["nut_quat"], world.finger_sign)
    assert_allclose(pos, grasp + poses.rotate(poses.rotation(truth["nut_quat"]), other[:, :3]), atol=2e-3)
    turned = poses.quat(poses.about([0.0, 0.0, 1.0], np.array([0.1, np.pi / 2 + 0.1, -0.2, 3.0])))
    assert_allclose(yaw_off(turned), [0.1, 0.1, -0.2, 3.0 - np.pi], atol=1e-12)
    assert_allclose(truth["nut_pos_m"][:, 2], TABLE_M + NUT_HALF_M, atol=1e-3)


@pytest.mark.parametrize(
    ("params", "told"),
    [
        ({"nut_x_m": (0.1, -0.1)}, "nut_x_m must be .low, high. with low ≤ high"),
        ({"sigma_m": (0.01,)}, r"sigma_m must be \[nut, peg\]"),
        ({"force_limit_n": 0.0}, "force_limit_n .0.0. above 0"),
        ({"peg_x_m": (0.9, 1.2)}, "no posture with the hand facing down"),
        ({"arm": "Robot"}, "unknown arm 'Robot'; known arms"),
    ],
)
def test_bad_parameters_are_one_message(params, told):
    with pytest.raises(ConfigError, match=told):
        Nut(**params)
