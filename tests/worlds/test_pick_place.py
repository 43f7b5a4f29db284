"""The bread task: what it starts from, what counts as done, why its skills fail and how they can be saved."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from p2l import poses
from p2l.contracts.observation import Observation
from p2l.errors import ConfigError
from p2l.skills import chain
from p2l.skills.primitives import PRIMITIVES
from p2l.worlds.pick_place.skills import quarter_turn
from p2l.worlds.pick_place.world import BIN1_POS_M, KINDS, THESIS_FIELDS, PickPlace

COLLISION, DROPPED = range(len(KINDS))
PRIMITIVE = {primitive.name: primitive for primitive in PRIMITIVES}


@pytest.fixture(scope="module")
def world():
    return PickPlace()


@pytest.fixture(scope="module")
def at_a_wall():
    """Breads so close to a wall at the right or the left that the hand must meet it, not close to the other two."""
    world = PickPlace(x_m=(-0.07, 0.07), y_m=(0.145, 0.17))
    rows = world.sample(np.random.default_rng(1), 16)
    return world, rows, chain.run(world, world.nominal_options(), rows)


def put_bread(world, rows, pos):
    """The same rows with the bread elsewhere, at rest."""
    states = rows.states.copy()
    states[:, 1 + world._bread_at : 4 + world._bread_at] = pos
    sensed = world.engine.sense(states, np.zeros((len(rows), len(world.engine.control_names))), rows.model)
    return replace(rows, states=states, sensors=sensed)


def test_starts_lie_in_the_ranges_at_rest():
    world = PickPlace(x_m=(-0.05, 0.1), y_m=(-0.2, 0.0), wall_clearance_m=0.1)
    rows = world.sample(np.random.default_rng(0), 500)
    place = world.read(rows, "object_pos")[:, :2] - BIN1_POS_M[:2]
    assert_allclose(place.min(axis=0), [-0.05, -0.14], atol=0.005)
    assert_allclose(place.max(axis=0), [0.09, 0.0], atol=0.005)
    assert_allclose(world.arm(rows).std(axis=0), 0.02, rtol=0.2)


def test_done_is_low_in_its_quarter_with_the_hand_away(world):
    rows = world.sample(np.random.default_rng(0), 1)
    cases = {
        (0.2, 0.16, 0.84): True,
        (0.2, 0.16, 0.91): False,  # not low enough
        (0.2, 0.3, 0.84): False,  # another quarter
        (0.05, 0.16, 0.84): False,  # yet another
        (0.1 + 0.195 + 1e-3, 0.16, 0.84): False,  # outside the bin
        (0.1 + 0.195 - 1e-3, 0.28 - 0.245 + 1e-3, 0.84): True,
    }
    for pos, done in cases.items():
        assert world.goal(put_bread(world, rows, pos))[0] == done, pos
    hand = world.read(rows, "grip_pos")[0]
    lifted = replace(rows, sensors=rows.sensors.copy())
    lifted.sensors[:, world.engine.sensor_columns["object_pos"]] = [0.2, 0.16, 0.84]
    for distance, done in ((0.042, False), (0.043, True)):  # robosuite: 1 − tanh(10 · distance) < 0.6
        lifted.sensors[:, world.engine.sensor_columns["grip_pos"]] = [0.2, 0.16, 0.84 + distance]
        assert world.goal(lifted)[0] == done
    assert hand[2] > 0.95


def test_the_observation_of_the_thesis_has_46_numbers(world):
    seen = world.observe(world.sample(np.random.default_rng(0), 2))
    assert sum(seen[name].shape[1] for name in THESIS_FIELDS) == 46


def test_away_from_walls_the_skills_succeed():
    world = PickPlace(wall_clearance_m=0.12)
    rows = world.sample(np.random.default_rng(2), 20)
    done = chain.run(world, world.nominal_options(), rows)
    assert done.success.mean() >= 0.95
    for index, option in enumerate(world.nominal_options()):
        begun = rows if index == 0 else done.ends.take(done.ends.option == index - 1).rows
        ready = option.precondition(world.privileged(begun))
        assert ready.mean() >= 0.9, option.name
        after = chain.run(world, world.nominal_options()[index:], begun.take(ready))
        assert after.success.mean() >= 0.9, option.name


def test_at_a_wall_the_hand_collides(at_a_wall):
    world, rows, done = at_a_wall
    assert not done.success.any()
    assert (done.last.kind == COLLISION).all()
    assert (world.observe(done.last.rows)["force_high"] == 1).all()
    assert (world.privileged(rows)["hand_room_m"] < 0).all()


def test_a_turned_hand_is_not_turned_back_and_fits_between_the_walls(at_a_wall):
    world, _, done = at_a_wall
    recovery = [PRIMITIVE["move -z"], PRIMITIVE["turn +z"]]
    moved = chain.run(world, recovery, done.last.rows, stop_on_failure=False)
    again = chain.run(world, world.nominal_options(), moved.last.rows)
    assert again.success.mean() >= 0.9
    turn = [poses.rotation(world.read(rows, "grip_quat")) for rows in (done.last.rows, again.last.rows)]
    assert_allclose((turn[0].inv() * turn[1]).magnitude(), np.pi / 2, atol=0.15)


def test_fingers_can_drag_the_bread_off_the_wall(at_a_wall):
    world, _, done = at_a_wall
    dragged = chain.run(world, [PRIMITIVE["move -x"]] * 5, done.last.rows, stop_on_failure=False)
    before, after = (world.read(rows, "object_pos")[:, 1] for rows in (done.last.rows, dragged.last.rows))
    assert (before - after > 0.03).all()
    assert chain.run(world, world.nominal_options(), dragged.last.rows).success.mean() >= 0.8


def test_a_hand_that_closes_on_nothing_has_dropped_the_bread():
    world = PickPlace(estimator="fixed", sigma_m=0.1, y_m=(-0.05, 0.05), x_m=(-0.05, 0.05))
    done = chain.run(world, world.nominal_options(), world.sample(np.random.default_rng(3), 16))
    dropped = done.last.kind == DROPPED
    assert dropped.sum() >= 4
    assert (world.gap_m(done.last.rows.take(dropped)) <= 0.01).all()


def test_the_hand_takes_the_closest_quarter_turn():
    def seen(rotation):
        return Observation.of({"target_quat": poses.quat(rotation)[None]})

    down = poses.rotation(poses.frame(np.array([[0.0, 1.0, 0.0]]), np.array([[0.0, 0.0, -1.0]])))[0]
    for quarters in range(4):
        wanted = poses.about([0.0, 0.0, 1.0], quarters * np.pi / 2)[0] * down
        for aside in (-0.6, 0.0, 0.6):
            hand = poses.about([0.0, 0.0, 1.0], aside)[0] * wanted * poses.about([1.0, 0.0, 0.0], 0.3)[0]
            taken = poses.rotation(quarter_turn(seen(hand)))[0]
            assert (taken.inv() * wanted).magnitude() < 1e-6
    on_its_side = down * poses.about([0.0, 1.0, 0.0], np.pi / 2)[0]
    assert (poses.rotation(quarter_turn(seen(on_its_side)))[0].inv() * down).magnitude() < 1e-6


@pytest.mark.parametrize(
    ("params", "message"),
    [
        ({"x_m": [0.1, -0.1]}, r"x_m must be \[low, high\] with low ≤ high, got \[0.1, -0.1\]"),
        ({"wall_clearance_m": 0.3}, r"wall_clearance_m must lie in \[0.0313, 0.19\], got 0.3"),
        ({"arm": "Pandas"}, "unknown arm 'Pandas'; known arms: Panda, UR5e"),
        ({"x_m": [-0.1, 0.15], "y_m": [-0.2, 0.2]}, r"no posture with the hand facing down at 0.250, -0.450, 1.000"),
    ],
)
def test_bad_parameters_are_refused_before_any_simulation(params, message):
    with pytest.raises(ConfigError, match=message):
        PickPlace(**params)
