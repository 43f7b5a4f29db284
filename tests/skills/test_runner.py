"""The runner on a real world: nobody waits, time is counted, a flag stops or is noted, a diverging row is put aside."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from examples.push.world import Push
from p2l.contracts.option import reads_observation
from p2l.contracts.rows import Command
from p2l.contracts.world import NO_FAILURE
from p2l.errors import ConfigError
from p2l.skills import chain
from p2l.skills.follow import Follow, Waypoints
from p2l.skills.runner import Reason, Runner


def wait(steps: int, name: str) -> Follow:
    """Hold still for a number of control steps."""

    def here(observation):
        return Waypoints(
            observation["target_pos_m"][:, None], observation["target_quat"][:, None], np.zeros((len(observation), 1))
        )

    return Follow(name, here, (steps,), (0,), lambda truth: np.ones(len(truth), dtype=np.bool_))


@pytest.fixture(scope="module")
def world():
    return Push(nthread=1)


def test_no_slot_waits_for_another(world):
    rows = world.sample(np.random.default_rng(0), 2)
    runner = Runner(world, (wait(3, "short"), wait(20, "long")), slots=2)
    runner.start(np.array([0, 1]), rows, np.array([0, 1]))
    ended = []
    for call in range(1, 22):
        events = runner.advance()
        ended += [(call, int(slot)) for slot in events.slot]
        if 0 in events.slot:
            runner.start(np.array([0]), rows.take([0]), np.array([0]))
    # A short option takes three steps and one call to be told of its end; the long one is not delayed by any of them.
    assert ended == [(4, 0), (8, 0), (12, 0), (16, 0), (20, 0), (21, 1)]
    assert runner.steps_total[1] == 20


def test_time_and_actions_are_counted(world):
    rows = world.sample(np.random.default_rng(0), 5)
    run = chain.run(world, (wait(3, "a"), wait(4, "b")), rows, slots=2)
    assert_array_equal(run.last.step, 7)
    assert_array_equal(run.last.rows.actions, 2)
    assert_array_equal(run.ends.option, [0, 1] * 5)
    assert_array_equal(run.ends.step, [3, 7] * 5)
    np.testing.assert_allclose(run.last.rows.states[:, 0], 7 * world.engine.control_period_s)


def test_a_timeout_ends_an_option_that_never_does(world):
    class Endless(Follow):
        def decide(self, observation, memory, step):
            decision = super().decide(observation, memory, step)
            return type(decision)(decision.command, decision.memory, np.zeros(len(observation), dtype=np.bool_))

    first = wait(5, "endless")
    endless = Endless(first.name, first.plan, first.legs, first.settle, first.ready)
    run = chain.run(world, (endless,), world.sample(np.random.default_rng(0), 2))
    assert_array_equal(run.last.reason, Reason.TIMEOUT)
    assert_array_equal(run.last.step, 5)


def test_a_flag_stops_the_episode_or_is_noted(world):
    rows = world.sample(np.random.default_rng(2), 40)
    stopped = chain.run(world, world.nominal_options(), rows)
    noted = chain.run(world, world.nominal_options(), rows, stop_on_failure=False)
    flagged = stopped.last.kind != NO_FAILURE
    assert 0 < flagged.sum() < len(rows)
    assert_array_equal(flagged, stopped.last.reason == Reason.FAILURE)
    assert_array_equal(stopped.last.kind_step[flagged], stopped.last.step[flagged])
    assert_array_equal(noted.last.kind, stopped.last.kind)
    assert_array_equal(noted.last.kind_step[flagged], stopped.last.step[flagged])
    assert (noted.last.step[flagged] >= stopped.last.step[flagged]).all()
    assert not stopped.success[flagged].any()


def test_more_episodes_than_slots_change_nothing(world):
    rows = world.sample(np.random.default_rng(3), 9)
    few, many = (chain.run(world, world.nominal_options(), rows, slots=slots) for slots in (2, 9))
    assert_array_equal(few.last.rows.states, many.last.rows.states)
    assert_array_equal(few.ends.episode, many.ends.episode)
    assert_array_equal(few.last.path_m, many.last.path_m)


def test_a_diverging_row_is_put_aside_and_the_batch_goes_on(world):
    rows = world.sample(np.random.default_rng(4), 3)
    sound = chain.run(world, world.nominal_options(), rows)
    rows.states[1, 1 + world.engine.nq] = 1e12
    run = chain.run(world, world.nominal_options(), rows)
    assert_array_equal(run.diverged, [False, True, False])
    assert run.last.reason[1] == Reason.DIVERGENCE
    assert not run.success[1]
    assert np.isfinite(run.last.rows.states).all()
    assert_array_equal(run.last.rows.states[[0, 2]], sound.last.rows.states[[0, 2]])


def test_the_way_is_the_sum_of_its_pieces(world):
    rows = world.sample(np.random.default_rng(0), 1)
    place = world.engine.physics_size
    points, at = [world.read(rows, "grip_pos")[0]], rows
    for step in range(8):
        target = rows.states[:, place : place + 3] + [0.0, 0.0, 0.01 * (step + 1)]
        at, *_ = world.advance(at, Command.pose(target, rows.states[:, place + 3 : place + 7], np.zeros(1)))
        points.append(world.read(at, "grip_pos")[0])
    lift = Follow(
        "lift",
        lambda observation: Waypoints(
            (observation["target_pos_m"] + [0.0, 0.0, 0.08])[:, None],
            observation["target_quat"][:, None],
            np.zeros((1, 1)),
        ),
        (8,),
        (0,),
        lambda truth: np.ones(len(truth), dtype=np.bool_),
    )
    run = chain.run(world, (lift,), rows)
    np.testing.assert_allclose(run.last.path_m[0], np.linalg.norm(np.diff(points, axis=0), axis=1).sum(), rtol=1e-9)


def test_an_empty_runner_is_refused(world):
    with pytest.raises(ConfigError, match="needs a slot and an option"):
        Runner(world, (), slots=2)


class Watched(Push):
    """Counts the rows that are observed."""

    observed = 0

    def observe(self, rows):
        self.observed += len(rows)
        return super().observe(rows)


class Looking(Follow):
    """Somebody else's option: as a `Follow`, and remembers where it saw the hand last."""

    def decide(self, observation, memory, step):
        decision = super().decide(observation, memory, step)
        memory = decision.memory.copy()
        memory[:, 7] = observation["grip_pos_m"][:, 0]
        return type(decision)(decision.command, memory, decision.done)


def test_only_rows_whose_option_reads_it_are_observed_at_a_control_step():
    world, blind = Watched(nthread=1), wait(6, "blind")
    looking = Looking("looking", blind.plan, blind.legs, blind.settle, blind.ready)
    assert [reads_observation(option) for option in (blind, looking, world.primitives()[0])] == [False, True, False]
    rows = world.sample(np.random.default_rng(0), 5)
    runner = Runner(world, (blind, looking), slots=5)
    runner.start(np.arange(5), rows, np.array([0, 1, 0, 0, 1]))
    world.observed = 0
    for step in range(1, 4):
        before = runner.rows.take(np.arange(5))
        runner.advance()
        assert world.observed == 2 * step
        seen = Push(nthread=1).observe(before)["grip_pos_m"][:, 0]
        assert_array_equal(runner.state()["_memory"][[1, 4], 7], seen[[1, 4]])
    world.observed = 0
    chain.run(world, (blind,), rows)
    assert world.observed == len(rows), "one observation of each row, at the start"
