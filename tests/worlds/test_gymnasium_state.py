"""States of environments: bytes and back, numbers of a model that have moved, and where a job's row comes from."""

from collections import OrderedDict, deque

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from p2l.contracts.world import NO_FAILURE
from p2l.worlds.gymnasium import Controller, GymnasiumWorld
from p2l.worlds.gymnasium.jobs import JobResult, Moment, OptionJob
from p2l.worlds.gymnasium.physics import MujocoState
from p2l.worlds.gymnasium.snapshot import differing_fields, pack, unpack

SCALARS = st.none() | st.booleans() | st.integers() | st.floats() | st.text() | st.binary(max_size=5)
ARRAYS = st.sampled_from(["<f8", "<f4", "<i8", "|u1", "|b1", "<U3"]).flatmap(
    lambda dtype: st.lists(st.integers(0, 9), max_size=5).map(lambda values: np.array(values).astype(dtype))
)
MOVABLE = ["body_pos", "body_mass", "geom_rgba", "geom_group", "jnt_range", "cam_pos", "dof_damping", "actuator_gear"]
VALUES = st.recursive(
    SCALARS | ARRAYS,
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.lists(inner, max_size=3).map(tuple)
        | st.lists(inner, max_size=3).map(lambda values: deque(values, 4))
        | st.dictionaries(st.text(max_size=3), inner, max_size=3)
        | st.dictionaries(st.text(max_size=3), inner, max_size=3).map(OrderedDict)
    ),
    max_leaves=8,
)


@given(st.dictionaries(st.text(max_size=4), VALUES, max_size=4))
@settings(max_examples=60, deadline=None)
def test_what_is_packed_comes_back_to_the_bit_and_with_its_types(fields):
    again = unpack(pack(fields) + b"rest")
    assert list(again) == list(fields)
    assert not differing_fields(fields, again)
    for name, value in fields.items():
        assert type(again[name]) is type(value)
        if isinstance(value, np.ndarray):
            assert again[name].dtype == value.dtype
            assert again[name].flags.owndata


@pytest.mark.parametrize("name", ["PCG64", "MT19937", "Philox", "SFC64"])
def test_a_generator_goes_on_where_it_was(name):
    generator = np.random.Generator(getattr(np.random, name)(3))
    generator.standard_normal(5, dtype=np.float32)
    old = np.random.RandomState(4)
    old.standard_normal(3)
    again = unpack(pack({"new": generator, "old": old}))
    assert_array_equal(again["new"].standard_normal(9), generator.standard_normal(9))
    assert_array_equal(again["old"].standard_normal(9), old.standard_normal(9))


@pytest.fixture(scope="module")
def reacher():
    env = gymnasium.make("Reacher-v5")
    env.reset(seed=0)
    return env, MujocoState(env)


@given(st.data())
@settings(max_examples=40, deadline=None)
def test_every_number_of_a_model_that_moves_is_kept_and_put_back(reacher, data):
    env, state = reacher
    model = env.unwrapped.model
    before = state.get(env)
    moved = data.draw(st.lists(st.sampled_from(MOVABLE), unique=True))
    for name in moved:
        value = getattr(model, name)
        value.flat[data.draw(st.integers(0, value.size - 1))] += 1
    after = state.get(env)
    kept = {name.removeprefix("model.") for name in after if name.startswith("model.")}
    assert kept == {name for name, was in state._reference.items() if getattr(model, name).tobytes() != was}
    assert set(moved) <= kept
    state.set(env, before)
    assert not differing_fields(before, state.get(env))
    state.set(env, after)
    assert not differing_fields(after, state.get(env))
    state.set(env, before)


def test_numbers_of_jobs_are_sent_to_the_bit():
    numbers = np.array([0.1, -0.0, 1e-310, np.pi])
    job = OptionJob(2, 3, numbers, numbers[:1], NO_FAILURE, True, False, 4, numbers[1:])
    again = OptionJob.of_plain(job.to_plain())
    result = JobResult.of_plain(JobResult(0, 5, numbers, 1, 2, False, 0.1, "told").to_plain())
    assert again.memory.tobytes() == result.memory.tobytes() == numbers.tobytes()
    assert again.command.tobytes() == numbers[1:].tobytes()
    assert OptionJob.of_plain((*job.to_plain()[:-1], None)).command is None
    assert (result.reason, result.steps, result.kind, result.kind_step, result.told) == (0, 5, 1, 2, "told")


def test_a_row_is_the_same_in_the_process_that_has_it_as_put_from_either_of_its_places():
    def act(obs, memory):
        return 0.3 * np.cos(memory[:1] + np.arange(2)), memory + 1.0, memory[0] > 90

    world = GymnasiumWorld(
        "reacher", lambda: gymnasium.make("Reacher-v5", max_episode_steps=500), [Controller("wave", act, 95, 1)],
        lambda info, obs: False, processes=1,
    )  # fmt: skip
    rows = world.sample(np.random.default_rng(0), 1)
    start = Moment(memoryview(rows.states[0]), rows.sensors[0])
    processes, ways = world.processes, {}
    for way in ("there", "left by a process", "given"):
        lane, other = processes.take_lanes(2).tolist()
        row, memory = start, np.zeros(1)
        for step in range(6):
            if way != "there":  # the process goes to another row in between
                processes.collect(processes.submit(other, "run", _job(0, np.zeros(1)), start))
            before = processes.copies()
            answer = processes.collect(processes.submit(lane, "run", _job(step, memory), row))
            memory = answer.memory
            assert processes.copies() - before == (1 if way == "there" and step else 2)
            state, sensed = processes.row(lane)
            row = Moment(memoryview(state.copy()), sensed.copy()) if way == "given" else None
        ways[way] = state.tobytes(), sensed.tobytes(), memory.tobytes()
        processes.give_lanes([lane, other])
    assert ways["there"] == ways["left by a process"] == ways["given"]


def _job(step, memory):
    return OptionJob(0, step, memory, np.zeros(0), NO_FAILURE, False, True, 1)
