"""Every registered world keeps the contract of `p2l.contracts.world`; a new one is covered on the day it is added."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from examples.metaworld_sawyer.world import world as sawyer
from p2l.contracts.observation import Observation, Privileged
from p2l.contracts.option import Option
from p2l.contracts.rows import Command, Rows
from p2l.contracts.world import NO_FAILURE, Scenic, World
from p2l.errors import ConfigError, P2LError
from p2l.skills import chain
from p2l.worlds.robot import RobotWorld
from p2l.worlds.table import WORLDS, make_world

WORLDS.register("push", "examples.push.world:Push")
WORLDS.register("their_fetch", "examples.fetch.world:world")
WORLDS.register("their_drawer", "tests.worlds.test_world_contract:drawer_open")
WORLDS.register("their_stack", "examples.robosuite_stack.world:world")
EPISODES = 6


def drawer_open(**params):
    return sawyer("drawer-open-v3", **params)


@pytest.fixture(scope="module", params=WORLDS.names())
def played(request):
    """The world, its chain, starts, and what the chain made of them."""
    world = make_world(request.param)
    options = world.nominal_options()
    rows = world.sample(np.random.default_rng(0), EPISODES)
    return world, options, rows, chain.run(world, options, rows, stop_on_failure=False, slots=4)


def hold(world: World, rows: Rows) -> Command:
    """Stay where the impedance target is, fingers open; no motion in an environment of another's."""
    if not isinstance(world, Scenic):
        return Command(world.command_columns, np.zeros((len(rows), world.command_columns["action"].stop)))
    place = world.engine.physics_size
    pose = rows.states[:, place : place + 7].copy()
    return Command.pose(pose[:, :3], pose[:, 3:], np.zeros(len(rows)))


def test_contracts_hold(played):
    world, options, rows, execution = played
    assert isinstance(world, World)
    assert all(isinstance(option, Option) for option in options)
    assert len({option.name for option in options}) == len(options) > 0
    assert len(set(world.failure_kinds)) == len(world.failure_kinds) > 0
    assert len(rows) == len(execution) == EPISODES
    assert not execution.diverged.any()
    assert execution.success.dtype == np.bool_
    assert set(np.unique(execution.ends.kind)) <= {NO_FAILURE, *range(len(world.failure_kinds))}
    assert (execution.last.step <= sum(option.max_steps for option in options)).all()
    assert (execution.last.path_m > 0).all()


def test_truth_and_observation_are_apart(played):
    world, options, rows, _ = played
    truth, seen = world.privileged(rows), world.observe(rows)
    assert type(truth) is Privileged
    assert type(seen) is Observation
    for known in (truth, seen):
        assert known.values.shape == (EPISODES, len(known.names))
        assert len(set(known.names)) == len(known.names)
        assert np.isfinite(known.values).all()
    ready = options[0].precondition(truth)
    assert ready.shape == (EPISODES,)
    assert ready.all(), "the first option must be applicable at every start"


def test_equal_generators_give_equal_starts_and_other_ones_differ(played):
    world, _, rows, _ = played
    again = world.sample(np.random.default_rng(0), EPISODES)
    for name, value in rows.arrays().items():
        assert_array_equal(again.arrays()[name], value, err_msg=name)
    assert (world.sample(np.random.default_rng(1), EPISODES).states != rows.states).any()


def test_a_row_alone_ends_as_in_the_batch(played):
    world, options, rows, execution = played
    alone = chain.run(world, options, rows.take([3]), stop_on_failure=False, slots=1)
    assert_array_equal(alone.last.rows.states[0], execution.last.rows.states[3])
    assert_array_equal(alone.last.kind[0], execution.last.kind[3])


def test_a_saved_moment_goes_on_to_the_bit(played):
    world, _, rows, _ = played
    first, *_ = world.advance(rows, hold(world, rows))
    saved = Rows.from_arrays({name: value.copy() for name, value in first.take([1, 4]).arrays().items()})
    whole, kind, _ = world.advance(first, hold(world, first))
    part, kind_part, _ = world.advance(saved, hold(world, saved))
    assert_array_equal(part.states, whole.states[[1, 4]])
    assert_array_equal(part.sensors, whole.sensors[[1, 4]])
    assert_array_equal(part.memory, whole.memory[[1, 4]])
    assert_array_equal(kind_part, kind[[1, 4]])


def test_a_start_is_neither_done_nor_failed(played):
    world, _, rows, _ = played
    after, kind, diverged = world.advance(rows, hold(world, rows))
    assert (kind == NO_FAILURE).all()
    assert not diverged.any()
    assert not world.goal(rows).any()
    assert_array_equal(after.actions, rows.actions)


def test_the_estimate_errs_as_told(played):
    world, _, _, _ = played
    rows = world.sample(np.random.default_rng(5), 200)
    error = world.estimator.error(rows.noise, rows.actions)
    assert error.shape == (200, len(world.estimator.sigma_m))
    if world.estimator.mode == "exact":
        assert not error.any()
    else:
        np.testing.assert_allclose(error.std(axis=0), world.estimator.sigma_m, rtol=0.25)


def test_nan_in_a_target_is_refused(played):
    world, _, rows, _ = played
    command = hold(world, rows)
    command.values[2, 1] = np.nan
    with pytest.raises(P2LError, match="holds NaN"):
        world.advance(rows, command)


def test_the_digest_does_not_follow_the_threads(played, request):
    world, *_ = played
    fewer = {"nthread": 1} if isinstance(world, Scenic) else {"processes": 1}
    assert make_world(request.node.callspec.params["played"], fewer).digest == world.digest


def test_unknown_names_list_the_known():
    with pytest.raises(ConfigError, match=r"unknown world 'doors'; known: .*door.*shelf"):
        make_world("doors")
    with pytest.raises(ConfigError, match=r"world 'push': unknown parameters \['colour'\]; allowed: .*estimator"):
        make_world("push", {"colour": "red"})


class Nothing:
    """Keeps no contract."""


class Unfinished(RobotWorld):
    def goal(self, rows):
        return np.ones(len(rows), dtype=bool)


def test_a_class_that_is_no_world_is_refused_and_says_what_it_lacks():
    with pytest.raises(
        ConfigError, match="world 'half': Unfinished lacks sample, _truth, _observation, monitor, nominal"
    ):
        Unfinished("half", {}, [], None)
    with pytest.raises(ConfigError, match=r"makes a Nothing, which is no .*World; it lacks advance,"):
        make_world(f"{__name__}:Nothing")
