"""What recoveries are before any training: guesses by hand on the door, and how one is chosen on the push world."""

import numpy as np
import pytest

from p2l import poses
from p2l.contracts.world import symbols_of
from p2l.errors import ConfigError
from p2l.metareskill import start as module
from p2l.metareskill.members import Members
from p2l.metareskill.query import QueryOptions
from p2l.metareskill.start import Start, measure_start, recorded_start
from p2l.metareskill.target import BEHIND_M, RecoveryTask
from p2l.skills.execute import execute, without_noise
from p2l.skills.relative import waypoints
from p2l.worlds.table import make_world
from tests.metareskill import pushing_back as pb

OPTIONS = QueryOptions(timing=pb.TIMING, verify=False)
HELD = np.array([[-0.045, 0.015, 0.0, 0.0, 0.0, 0.0, 0.02, 0.0, 0.0]])  # around the lever, door shut, lever at rest


@pytest.fixture(scope="module")
def door():
    world = make_world("door", {"nthread": 1, "estimator": "exact"})
    rows = world.sample(np.random.default_rng(0), 3)
    return RecoveryTask(world, symbols_of(world), None), world.observe(rows)


def turned(symbols, latch_rad, hinge_rad=0.0):
    state = np.repeat(HELD, 3, axis=0)
    state[:, 8], state[:, 7] = latch_rad, hinge_rad
    return state


def test_take_comes_from_behind_and_closes_where_the_things_are_now(door):
    task, seen = door
    goals = turned(task.symbols, latch_rad=1.2)  # the lever is at rest now: it is held there, not where the goal has it
    way = waypoints(seen, task.guess("take", seen, seen, goals))
    pos, quat = task.symbols.hand(seen, turned(task.symbols, 0.0))
    np.testing.assert_allclose(way.pos[:, 1:], np.repeat(pos[:, None], 2, axis=1), atol=1e-9)
    axis = poses.rotate(poses.rotation(quat), [0.0, 0.0, 1.0])
    np.testing.assert_allclose(way.pos[:, 0], pos - BEHIND_M * axis, atol=1e-9)
    np.testing.assert_allclose(np.abs((way.quat * quat[:, None]).sum(axis=-1)), 1.0, atol=1e-9)
    assert way.grip.tolist() == [[0.0, 0.0, 1.0]] * 3


def test_carry_takes_hold_where_the_things_are_and_goes_with_them(door):
    task, seen = door
    goals = turned(task.symbols, latch_rad=1.2, hinge_rad=0.3)
    way = waypoints(seen, task.guess("carry", seen, seen, goals))
    now, there = task.symbols.hand(seen, turned(task.symbols, 0.0))[0], task.symbols.hand(seen, goals)[0]
    np.testing.assert_allclose(way.pos, np.stack([now, now, there], axis=1), atol=1e-9)
    assert np.linalg.norm(there - now, axis=1).min() > 0.05
    assert way.grip.tolist() == [[0.0, 1.0, 1.0]] * 3


@pytest.mark.parametrize("name", ["take", "carry"])
def test_with_open_fingers_there_is_nothing_to_take_hold_of(door, name):
    task, seen = door
    goals = turned(task.symbols, 0.0)
    goals[:, 6] = 0.08
    np.testing.assert_array_equal(task.guess(name, seen, seen, goals), task.guess("straight", seen, seen, goals))


@pytest.fixture(scope="module")
def push():
    _, task, _ = pb.setting(estimator="exact")
    rows = pb.standing(task.world, np.array([0.10, 0.13, 0.16, 0.10]), 0.08)
    tests = pb.standing(task.world, np.array([0.12, 0.15]), 0.08)
    return task, Members(rows, np.array([0, 0, 0, 1])), Members(tests, np.array([0, 1]))


def test_a_start_is_what_a_fresh_run_of_its_guesses_gives(push):
    task, failures, held_out = push
    start = measure_start(task, failures, held_out, range(2), OPTIONS, ["straight"], 5)
    rows = without_noise(held_out.rows)
    for target in range(3):
        arrivals = execute(task.world, rows, task.straight(task.world.observe(rows), target), pb.TIMING)
        np.testing.assert_array_equal(start.q[:, target], task.holds(arrivals.last)[:, target])
    assert start.rollouts == 3 * (3 + 1) + 3 * (1 + 1)


def test_the_guess_that_does_best_from_training_failures_is_taken_and_of_equals_the_first(push, monkeypatch):
    worth = {"straight": (0.1, 5.0), "take": (0.6, 1.0), "carry": (0.6, 1.0)}
    monkeypatch.setattr(module, "_outcome", lambda _task, _rows, guess, _target, _options: worth[guess])
    start = measure_start(*push, range(2), OPTIONS, ["straight", "take", "carry"], 5)
    assert {guess for row in start.guess for guess in row} == {"take"}
    assert (start.q == 0.6).all()


def test_a_start_is_measured_once_and_then_read(push, tmp_path, monkeypatch):
    task, failures, held_out = push
    given = task, failures, held_out, OPTIONS
    first = recorded_start(tmp_path, "push", *given, ["straight", "take"], 5)
    monkeypatch.setattr(module, "measure_start", None)
    again = recorded_start(tmp_path, "push", *given, ["straight", "take"], 5)
    assert again.guess == first.guess
    np.testing.assert_array_equal(again.q, first.q)
    monkeypatch.undo()
    recorded_start(tmp_path, "push", *given, ["straight"], 5)
    assert len(list(tmp_path.iterdir())) == 2, "another choice is another record, and none is overwritten"


def test_without_guesses_nothing_works_before_it_is_trained(push, tmp_path):
    task, failures, held_out = push
    start = recorded_start(tmp_path, "push", task, failures, held_out, OPTIONS, [], 5)
    assert not start.q.any()
    assert {guess for row in start.guess for guess in row} == {""}
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("guesses", [["straight", "fly"], ["take", "take"]])
def test_unknown_guesses_are_refused(guesses):
    with pytest.raises(ConfigError, match=r"^guesses: "):
        module.check_guesses(guesses)


def test_starts_of_further_modes_come_after():
    one, more = Start((("straight",) * 2,), np.full((1, 2), 0.5), ("straight",), 10), Start.nothing(2, 2)
    both = one.beside(more)
    assert both.guess == (("straight",) * 2, ("",) * 2, ("",) * 2)
    assert both.q.tolist() == [[0.5, 0.5], [0.0, 0.0], [0.0, 0.0]]
