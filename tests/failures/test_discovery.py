"""Discovery: what counts as a failure under each strategy, and that a failure is enough to go on from, to the bit."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from p2l.errors import ConfigError
from p2l.failures.discovery import find_failures, nominal_run, replay, stranded
from p2l.failures.record import STRANDED
from p2l.failures.strategy import STRATEGIES
from p2l.skills.chain import run
from p2l.skills.runner import Reason
from tests.failures.pushing import found, setting

NOISE = {"sigma_m": 0.03}


@pytest.fixture(scope="module", params=STRATEGIES)
def pushed(request):
    return found(request.param, **NOISE)


@pytest.fixture(scope="module")
def door():
    return found("pessimistic", world="door", episodes=16)


def test_the_world_fails_and_succeeds(pushed):
    _, _, made = pushed
    assert 0 < made.execution.success.sum() < len(made.execution)
    assert len(made.failures) > 3
    assert not set(made.failures.episode) & set(np.flatnonzero(made.execution.success))


def test_a_failure_leaves_no_option_and_no_goal_unless_a_detector_ended_it(pushed):
    world, options, made = pushed
    failures, strategy = made.failures, made.failures.origin.strategy
    if strategy == "first_flag":
        assert (made.execution.last.reason[failures.episode] == Reason.FAILURE).all()
        assert STRANDED not in failures.kind_names()
    else:
        assert stranded(world, options, failures.rows).all()
        assert stranded(world, options, made.execution.ends.rows).sum() == len(failures)
    assert_array_equal(failures.truth.values, world.privileged(failures.rows).values)
    assert_array_equal(failures.seen.values, world.observe(failures.rows).values)
    assert_array_equal(failures.time_s, np.round(failures.step * 0.05, 6))


def test_pessimistic_discovery_goes_on_after_failing(door):
    _, _, made = door
    assert np.bincount(made.failures.episode).max() > 1
    assert (made.failures.step < made.execution.last.step[made.failures.episode]).any()


def test_the_others_end_with_the_failure(pushed):
    _, _, made = pushed
    assert np.bincount(made.failures.episode).max() == 1
    assert_array_equal(made.failures.step, made.execution.last.step[made.failures.episode])


def test_early_termination_tries_again_what_can_be_tried_again():
    """A hand beside the block, and behind it, may align anew; with ten options the halved noise lets it succeed."""
    _, _, once = found("pessimistic", **NOISE)
    _, _, again = found("early_termination", **NOISE)
    assert again.execution.success.sum() > once.execution.success.sum()
    assert again.execution.last.rows.actions.max() <= 10
    assert again.execution.last.rows.actions.max() > 2


def test_replay_ends_in_the_recorded_moment(pushed, caplog):
    world, options, made = pushed
    few = made.failures.take(np.arange(4))
    paths = replay(world, options, few)
    assert [len(path) for path in paths] == (few.step + 1).tolist()
    for index, path in enumerate(paths):
        assert_array_equal(path.states[0], few.start.states[index])
        assert_array_equal(path.states[-1], few.rows.states[index])
    assert not caplog.records  # it came there by itself


def test_a_door_failure_goes_on_to_the_bit(door):
    """Restored failures of a real world run the rest of the chain to the very state of the first execution."""
    world, options, made = door
    early = np.flatnonzero(made.failures.option < len(options) - 1)
    chosen = made.failures.take(early[:: max(1, len(early) // 5)])
    rest = run(world, options, chosen.rows, first=chosen.option + 1, stop_on_failure=False, slots=3)
    original = made.execution.last.take(chosen.episode)
    for name, value in rest.last.rows.arrays().items():
        assert_array_equal(value, original.rows.arrays()[name], err_msg=name)
    assert_array_equal(rest.last.kind, original.kind)
    assert_array_equal(rest.last.step + chosen.step, original.step)


def test_a_door_failure_is_reached_again_from_its_start(door, caplog):
    world, options, made = door
    replay(world, options, made.failures.take([0, len(made.failures) - 1]))
    assert not caplog.records


def test_an_episode_whose_simulation_breaks_down_is_left_out_and_the_others_go_on():
    world, options, starts, origin = setting("pessimistic", episodes=12, **NOISE)
    sound = find_failures(world, options, starts, origin)
    starts.states[[3, 7], 1 + world.engine.nq] = 1e12  # a velocity that MuJoCo gives up on
    made = find_failures(world, options, starts, origin)
    assert_array_equal(np.flatnonzero(made.execution.diverged), [3, 7])
    assert not made.execution.success[[3, 7]].any()
    assert not set(made.failures.episode) & {3, 7}
    others = np.flatnonzero(~np.isin(sound.failures.episode, [3, 7]))
    assert_array_equal(made.failures.rows.states, sound.failures.take(others).rows.states)


def test_no_failure_is_an_empty_record():
    _, _, made = found("pessimistic", sigma_m=0.0, episodes=5)
    assert made.execution.success.all()
    assert len(made.failures) == 0


def test_a_nominal_run_is_told_step_by_step():
    world, options, starts, _ = setting("pessimistic", episodes=1, sigma_m=0.0)
    path, done = nominal_run(world, options, starts)
    assert done
    assert len(path) == 41
    assert_array_equal(path.states[0], starts.states[0])
    assert world.goal(path.take([40]))[0]


def test_an_unknown_strategy_is_refused():
    world, options, starts, origin = setting("pessimistic", episodes=1)
    with pytest.raises(ConfigError, match="'optimistic'; known: pessimistic, early_termination, first_flag"):
        find_failures(world, options, starts, type(origin)(**{**vars(origin), "strategy": "optimistic"}))
