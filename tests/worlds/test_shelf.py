"""The shelves: what differs from row to row, what detectors say, when it is done, why the skills fail and can go on."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from p2l import poses
from p2l.contracts.rows import Command
from p2l.contracts.world import NO_FAILURE
from p2l.errors import ConfigError
from p2l.skills import chain
from p2l.worlds.shelf import hold as shelf_hold
from p2l.worlds.shelf.scene import DEPTH_M, INNER_WIDTH_M, TABLE_M
from p2l.worlds.shelf.world import COLLISION, SLIP, ClutteredShelf, Shelf

UP, OUT = np.array([[0.0, 0.0, 0.02], [0.0, -0.02, 0.0]])


@pytest.fixture(scope="module")
def world():
    return Shelf()


@pytest.fixture(scope="module")
def cluttered():
    return ClutteredShelf()


def seen_wrong(rows, y_m, z_m):
    """The same rows, the box seen that far off."""
    noise = np.zeros_like(rows.noise)
    noise[:, :, 0], noise[:, :, 1] = y_m / 0.01, z_m / 0.02
    return replace(rows, noise=noise)


@pytest.fixture(scope="module")
def exact(world):
    rows = seen_wrong(world.sample(np.random.default_rng(0), 12), 0.0, 0.0)
    return chain.run(world, world.nominal_options(), rows)


@pytest.fixture(scope="module")
def too_high(world):
    """Boxes that are seen 2 cm higher than they are: they hang too low for the shelf's floor."""
    rows = seen_wrong(world.sample(np.random.default_rng(1), 8), 0.0, 0.02)
    return chain.run(world, world.nominal_options(), rows)


def primitive(world, rows, shift):
    """Ten control steps with the target at a displacement from the hand, the fingers as they are."""
    place = world.engine.physics_size
    pos, quat = world.read(rows, "grip_pos") + shift, rows.states[:, place + 3 : place + 7]
    kinds = []
    for _ in range(10):
        rows, kind, diverged = world.advance(rows, Command.pose(pos, quat, rows.grip))
        assert not diverged.any()
        kinds.append(kind)
    return rows, np.array(kinds)


def test_rows_differ_in_one_model(cluttered):
    rows = cluttered.sample(np.random.default_rng(0), 40)
    truth = cluttered.privileged(rows)
    shelf, height = truth["shelf_pos_m"], truth["shelf_height_m"][:, 0]
    assert ((shelf > [0.0, 0.30, TABLE_M + 0.05]) & (shelf < [0.05, 0.35, TABLE_M + 0.10])).all()
    assert ((height > 0.21) & (height < 0.30)).all()
    assert np.ptp(height) > 0.05
    assert np.ptp(shelf, axis=0).min() > 0.02
    for name, half in zip(("left", "right"), np.swapaxes(cluttered.bank.clutter_half_m[rows.model], 0, 1), strict=True):
        off = truth[f"clutter_{name}_pos_m"] - shelf
        assert_allclose(off[:, 2], half[:, 1])
        assert (np.abs(off[:, 0]) + 0.02 < INNER_WIDTH_M / 2).all()
        assert (np.abs(off[:, 1]) + half[:, 0] < DEPTH_M / 2).all()
    assert_array_equal(truth["clutter_left_turn_rad"], 0.0)


def test_models_differ_in_mass_and_size(cluttered):
    density = []
    for scene, halves in zip(cluttered.scenes, cluttered.bank.clutter_half_m, strict=True):
        body = scene.model.body("object_main")
        density.append(float(body.mass[0]) / (8 * 0.02 * 0.06 * 0.08))
        # A solid cuboid: m / 3 · (half_y² + half_z²) about x, and so on.
        assert_allclose(body.inertia[0], body.mass[0] / 3 * (0.06**2 + 0.08**2), rtol=1e-6)
        box, half = scene.model.body("clutter_left_main"), np.array([0.02, *halves[0]])
        assert_allclose(box.mass[0], 100.0 * 8 * half.prod())
        assert_allclose(box.inertia[2], box.mass[0] / 3 * (half[0] ** 2 + half[1] ** 2))
        assert_allclose(scene.model.geom_size[scene.model.geom_bodyid == box.id], half[None])
    assert_allclose(density, np.linspace(200, 300, 33)[1::2])
    model = cluttered.visual_model(3)
    assert_allclose(model.geom("clutter_left_g0_vis").size[1:], cluttered.bank.clutter_half_m[3, 0])
    mujoco.mj_forward(model, mujoco.MjData(model))


def test_what_is_seen_errs_in_y_and_z_only(world):
    rows = world.sample(np.random.default_rng(2), 500)
    error = world.observe(rows)["object_pos_m"] - world.privileged(rows)["object_pos_m"]
    assert_array_equal(error[:, 0], 0.0)
    assert_allclose(error[:, 1:].std(axis=0), [0.01, 0.02], rtol=0.1)
    assert "object_quat" not in world.observe(rows).columns


def test_the_shelf_may_be_seen_in_the_wrong_place():
    world = Shelf(sigma_m=(0.0, 0.0), shelf_sigma_m=(0.0, 0.0, 0.02), models=1)
    rows = world.sample(np.random.default_rng(0), 4)
    seen, truth = world.observe(rows), world.privileged(rows)
    assert_array_equal(seen["object_pos_m"], truth["object_pos_m"])
    off = seen["shelf_pos_m"] - truth["shelf_pos_m"]
    assert_array_equal(off[:, :2], 0.0)
    assert (off[:, 2] != 0.0).all()


def test_upright_is_the_tilt_whatever_the_turn():
    tilt, turn = poses.about([1.0, 0.0, 0.0], 0.3), poses.about([0.0, 0.0, 1.0], 2.0)
    quats = poses.quat(turn * tilt)
    # Unit quaternions an angle of tilt / 2 apart are 2 sin(tilt / 4) from each other.
    assert_allclose(shelf_hold.upright_distance(quats), 2 * np.sin(0.3 / 4))
    assert_allclose(shelf_hold.upright_distance(poses.quat(turn)), 0.0, atol=1e-7)


def test_a_slip_counts_from_the_lift_and_after_a_flag_from_there():
    def pose(angle):
        return np.array([[0.0, 0.0, 0.04 + angle / 10]]), poses.quat(poses.about([1.0, 0.0, 0.0], angle))

    closed, up = np.array([True]), np.array([True])
    memory = np.zeros((1, shelf_hold.MEMORY_SIZE))
    for _ in range(shelf_hold.CLOSING_STEPS - 1):
        memory = shelf_hold.hold(memory, closed, up, pose(0.1), pose(0.1))
        assert memory[0, shelf_hold.GRASP] == 0
    memory = shelf_hold.hold(memory, closed, up, pose(0.1), pose(0.2))
    assert_allclose(np.ravel(shelf_hold.slip(pose(0.5), memory)), [0.3, 0.03])
    memory[:, shelf_hold.FLAG] = 1.0
    memory = shelf_hold.hold(memory, closed, up, pose(0.5), pose(0.6))
    assert_allclose(np.ravel(shelf_hold.slip(pose(0.6), memory)), [0.1, 0.01])
    memory = shelf_hold.hold(memory, ~closed, up, pose(0.6), pose(0.9))
    assert_array_equal(np.ravel(shelf_hold.slip(pose(0.9), memory)), [0.0, 0.0])
    assert memory[0, shelf_hold.LIFT] == 1


def test_an_exact_state_leads_onto_the_shelf(world, exact):
    assert exact.success.all()
    truth = world.privileged(exact.last.rows)
    off = truth["object_pos_m"] - truth["shelf_pos_m"] - [0.0, 0.0, 0.08]
    assert (np.abs(off) < [0.02, 0.02, 0.002]).all()
    lifted = world.privileged(exact.ends.take(exact.ends.option == 0).rows)
    assert (lifted["held"] == 1).all()
    assert (lifted["slip_rad"] < 0.1).all()


def test_preconditions_hold_along_the_chain_and_tell_what_cannot_work(world, exact, too_high):
    chained = world.nominal_options()
    for option in (1, 2):
        before = exact.ends.take(exact.ends.option == option - 1).rows
        assert chained[option].precondition(world.privileged(before)).mean() >= 0.8
    moved = world.privileged(too_high.ends.take(too_high.ends.option == 1).rows)
    assert len(moved) == 8
    assert not chained[2].precondition(moved).any()
    assert not chained[0].precondition(moved).any()


def test_a_box_that_hangs_too_low_collides_with_the_edge(world, too_high):
    assert not too_high.success.any()
    assert (too_high.last.option == 2).all()
    assert set(too_high.last.kind) <= {COLLISION, SLIP}
    truth = world.privileged(too_high.last.rows)
    collided = too_high.last.kind == COLLISION
    assert (truth["force_n"][collided] > world.force_limit_n).all()
    assert (truth["slip_rad"][~collided] > world.slip_limit_rad).all()
    mouth = truth["shelf_pos_m"][:, 1] - DEPTH_M / 2
    assert (np.abs(truth["object_pos_m"][:, 1] + 0.06 - mouth) < 0.03).all()


def test_out_and_up_and_place_recovers_from_the_edge(world, too_high):
    rows = too_high.last.rows
    kinds = []
    for shift in (OUT, UP, UP):
        rows, kind = primitive(world, rows, shift)
        kinds.append(kind)
    assert (np.concatenate(kinds)[5:] == NO_FAILURE).all(), "a hand that has moved off is not stopped again"
    placed = chain.run(world, world.nominal_options()[2:], rows)
    assert placed.success.mean() >= 0.75


def test_clutter_that_is_turned_is_a_failure(cluttered):
    rows = seen_wrong(cluttered.sample(np.random.default_rng(0), 2), 0.0, 0.0)
    after = rows.states.copy()
    joint = cluttered._columns[cluttered.bank.clutter_joints[0]]
    after[0, joint + 3 : joint + 7] = poses.quat(poses.about([0.0, 0.0, 1.0], 0.3))[0]
    sensed = cluttered.engine.sense(after, np.zeros((2, len(cluttered.engine.control_names))), rows.model)
    assert_allclose(
        cluttered.privileged(replace(rows, states=after, sensors=sensed))["clutter_left_turn_rad"][:, 0],
        [0.3, 0.0],
        atol=1e-6,
    )
    done = chain.run(
        cluttered, cluttered.nominal_options(), seen_wrong(cluttered.sample(np.random.default_rng(1), 10), 0.0, 0.0)
    )
    assert done.success.mean() >= 0.8


@pytest.mark.parametrize("params", [{"arm": "UR5e"}, {"object": "can"}, {"object": "bottle"}])
def test_variants_succeed_with_an_exact_state(params):
    world = Shelf(estimator="exact", models=2, **params)
    done = chain.run(world, world.nominal_options(), world.sample(np.random.default_rng(0), 8))
    assert done.success.sum() >= 7


@pytest.mark.parametrize("arm", ["UR5e", "XArm7", "Sawyer"])
def test_every_arm_observes_the_hand_as_the_one_that_policies_are_learnt_on(arm):
    """q and −q are the same orientation; a network sees opposites. The arms' joints add up to either."""
    seen, truth = {}, {}
    for name in ("Panda", arm):
        world = Shelf(arm=name, estimator="exact", models=1)
        rows = chain.run(world, world.nominal_options(), world.sample(np.random.default_rng(2), 4)).last.rows
        seen[name], truth[name] = world.observe(rows), world.privileged(rows)
        assert poses.angle(seen[name]["grip_quat"], truth[name]["grip_quat"]) == pytest.approx(0.0, abs=1e-6)
    for field in ("grip_quat", "target_quat"):
        alike = (seen["Panda"][field] * seen[arm][field]).sum(axis=1)
        assert (alike > 0.9).all()
    assert_array_equal(seen["Panda"]["grip_quat"], truth["Panda"]["grip_quat"])  # what is learnt stays valid


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"object": "plate"}, "unknown object 'plate'; known objects: box, box_small, box_large, bottle, can"),
        ({"arm": "Spot"}, "unknown arm 'Spot'; known arms: Panda"),
        ({"shelf_y_m": (0.35, 0.30)}, r"shelf_y_m must be \[low, high\] with low ≤ high"),
        ({"shelf_height_m": (0.1, 0.3)}, r"shelf_height_m must lie within \[0.17, 0.32\]"),
        ({"shelf_y_m": (0.8, 0.9)}, r"no posture with the hand facing the shelf at \[.*bring object_x_m"),
        ({"sigma_m": (0.01,)}, "sigma_m must hold 2 numbers"),
        ({"force_limit_n": 0.0}, "force_limit_n must be positive"),
    ],
)
def test_bad_parameters_are_refused_before_anything_moves(params, message):
    with pytest.raises(ConfigError, match=message):
        Shelf(models=1, **params)
