"""Environments as worlds: what their runner does is what stepping their rows one by one does, to the bit."""

import os
import signal
import time
from collections import OrderedDict, namedtuple

import gymnasium
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from p2l.contracts.rows import Rows
from p2l.errors import ConfigError
from p2l.skills import chain
from p2l.skills.runner import Reason, Runner
from p2l.worlds.gymnasium import Controller, GymnasiumWorld, HeldAction, Noise, box_primitives, processes
from p2l.worlds.table import make_world

Task = namedtuple("Task", ["name", "data"])


class Line(gymnasium.Env):
    """A point on a line that is pushed by its action; wind comes from its own generator."""

    action_space = gymnasium.spaces.Box(-1.0, 1.0, (1,), np.float32)
    observation_space = gymnasium.spaces.Box(-9.0, 9.0, (2,), np.float64)
    hidden = 0.0
    nan_at = 99
    dt = 0.1

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.at, self.count = float(self.np_random.uniform(-0.2, 0.2)), 0
        return self._see(), {}

    def step(self, action):
        self.count += 1
        self.at += 0.1 * float(action[0]) + 0.01 * float(self.np_random.standard_normal())
        if self.count == self.nan_at:
            self.at = np.nan
        return self._see(), 0.0, bool(self.at > 2.0), self.count >= 60, {"done": self.at > 1.0}

    def _see(self):
        return np.array([self.at, self.count / 100])


class Forgetful(Line):
    """What it adds is no part of the state that its functions keep."""

    def step(self, action):
        seen, *rest = super().step(action)
        type(self).hidden += 1.0
        return seen + [0.0, type(self).hidden], *rest


class Unseeded(Line):
    """Its start is drawn by nobody knows what."""

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.at = float(np.random.default_rng().uniform(-0.2, 0.2))
        return self._see(), {}


class Broken(Line):
    nan_at = 3


def get_state(env):
    return {"at": env.at, "count": env.count, "generator": env.np_random}


def set_state(env, state):
    env.at, env.count = state["at"], state["count"]
    env.np_random.bit_generator.state = state["generator"].bit_generator.state


def go(obs, memory):
    return [1.0], memory + 1.0, obs[0] > 1.05


def line(make_env=Line, *, act=go, max_steps=50, name="line", state=(get_state, set_state), **rest):
    settings = {
        "primitives": box_primitives(0.5, 4, ["x"]),
        "failed": lambda info, obs: "far" if obs[0] < -0.5 else None,
        "failures": ["far"],
        "noise": [Noise(0.05, ["observation[0]"])],
        "fields": {"position_m": "observation[0]"},
        "position": "observation[0]",
        "get_state": state[0],
        "set_state": state[1],
    }
    controllers = [Controller("go", act, max_steps, 1)]
    return GymnasiumWorld(
        name, make_env, controllers, lambda info, obs: bool(info["done"]), **{"processes": 1, **settings, **rest}
    )


@pytest.fixture(scope="module")
def world():
    return line(processes=2)


def same(one: Rows, other: Rows):
    for name, value in one.arrays().items():
        assert_array_equal(value, other.arrays()[name], err_msg=name)


def by_rows(world, options, rows):
    """The chain by the runner that steps rows in this process."""
    runner = Runner(world, options, len(rows))
    runner.start(np.arange(len(rows)), rows, np.zeros(len(rows), dtype=np.int64))
    while runner.busy.any():
        events = runner.advance()
        going = (events.reason != Reason.FAILURE) & (runner.option[events.slot] + 1 < len(options))
        runner.begin(events.slot[going], runner.option[events.slot[going]] + 1)
    return runner


def test_whole_options_in_processes_do_what_single_steps_of_rows_do(world):
    rows = world.sample(np.random.default_rng(0), 12)
    options = world.nominal_options()
    execution = chain.run(world, options, rows, slots=5)
    slow = by_rows(world, options, rows)
    same(execution.last.rows, slow.rows)
    assert_array_equal(execution.last.step, slow.steps_total)
    np.testing.assert_allclose(execution.last.path_m, slow.path_m, rtol=1e-12)
    assert execution.success.mean() > 0.5


def test_neither_slots_nor_processes_nor_order_change_what_happens(world):
    rows = world.sample(np.random.default_rng(1), 9)
    one = chain.run(world, world.nominal_options(), rows, slots=9)
    alone = chain.run(line(), world.nominal_options(), rows, slots=2)
    same(one.last.rows, alone.last.rows)
    assert_array_equal(one.ends.step, alone.ends.step)


def test_a_runner_goes_on_from_what_it_has_kept(world):
    rows = world.sample(np.random.default_rng(2), 16)
    options = (*world.primitives(), *world.nominal_options())
    first = world.runner(options, 16, stop_on_failure=True)
    first.start(np.arange(16), rows, np.arange(16) % len(options))
    first.advance()
    state = {name: value.copy() for name, value in first.state().items()}
    again = world.runner(options, 16, stop_on_failure=True)
    again.restore(state)
    for _ in range(3):
        mine, its = first.advance(), again.advance()
        assert_array_equal(mine.slot, its.slot)
        assert_array_equal(mine.reason, its.reason)
    same(first.rows, again.rows)


def test_a_process_that_dies_is_replaced_and_its_row_has_diverged(world, caplog):
    rows = world.sample(np.random.default_rng(3), 6)
    runner = world.runner(world.nominal_options(), 6, stop_on_failure=True)
    runner.start(np.arange(6), rows, np.zeros(6, dtype=np.int64))
    os.kill(world.processes.pids[0], signal.SIGKILL)
    reasons = {}
    while runner.busy.any():
        events = runner.advance()
        reasons |= dict(zip(events.slot.tolist(), events.reason.tolist(), strict=True))
    assert len(reasons) == 6
    assert list(reasons.values()).count(Reason.DIVERGENCE) <= 1
    assert "its row counts as diverged, another process takes its place" in caplog.text
    again = chain.run(world, world.nominal_options(), rows, slots=6)
    assert not again.diverged.any()


def test_the_lanes_of_a_runner_that_is_dropped_at_work_are_nobody_else_s(world):
    """Its jobs went on, and wrote their rows where the next runner's were."""
    options = world.nominal_options()
    rows, others = world.sample(np.random.default_rng(1), 12), world.sample(np.random.default_rng(2), 12)
    alone = chain.run(world, options, others, slots=12)
    for _ in range(3):
        runner = world.runner(options, 12, stop_on_failure=True)
        runner.place(np.arange(12), rows)
        runner.begin(np.arange(12), np.zeros(12, dtype=np.int64))
        runner.advance()  # the others are at work
        del runner
        same(chain.run(world, options, others, slots=12).last.rows, alone.last.rows)
    processes = world.processes
    assert processes.copies() > 0
    assert (len(processes._free) + len(processes._given), processes._results) == (1024, {})


def test_no_state_is_copied_while_an_option_goes_on(world):
    rows = world.sample(np.random.default_rng(4), 20)
    before = world.processes.copies()
    execution = chain.run(world, world.nominal_options(), rows, slots=10)
    made = world.processes.copies() - before
    assert made <= 2 * len(execution.ends) < int(execution.last.step.sum()) / 3


def test_estimates_err_together_and_detectors_see_what_the_robot_sees(world):
    rows = world.sample(np.random.default_rng(5), 300)
    error = world.observe(rows)["position_m"] - world.privileged(rows)["position_m"]
    assert 0.04 < error.std() < 0.06
    assert_array_equal(world.observe(rows)["observation[1:2]"], world.privileged(rows)["observation[1:2]"])


def test_an_environment_that_ends_by_itself_is_a_failure_unless_the_task_is_done():
    wait = line(act=lambda obs, memory: ([0.0], memory + 1.0, memory[0] > 70), max_steps=100, name="wait")
    execution = chain.run(wait, wait.nominal_options(), wait.sample(np.random.default_rng(0), 3), slots=3)
    assert [wait.failure_kinds[kind] for kind in execution.last.kind] == ["truncated"] * 3
    assert (execution.last.step == 60).all()


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"make_env": Forgetful}, r"after 1 control step observation 'observation' differs, and of the state no kept"),
        ({"state": (lambda env: {"at": env.at, "count": env.count}, lambda env, s: vars(env).update(s))},
         r"does not go on as it did: after 1 control step observation 'observation' differs.*at"),
        ({"state": (get_state, lambda env, s: set_state(env, {**s, "count": 0}))}, "does not go on as it did: .*count"),
        ({"make_env": Unseeded}, r"env.reset\(seed=1\) gives one start in one environment of make_env and another"),
        ({"act": lambda obs, memory: ([0.0], memory, False), "failed": lambda info, obs: obs[0] < 0.0},
         "never ends by itself: of 10 runs with exact observations . met its bound of 50"),
        ({"make_env": Broken}, "the observation holds NaN or infinity in 'observation'"),
        ({"act": lambda obs, memory: ([0.0], memory, False)}, "'go' never ends by itself: of 10 runs"),
        ({"act": lambda obs, memory: ([0.0, 1.0], memory, False)}, r"its action has shape \(2,\), not the environment"),
        ({"act": lambda obs, memory: ([np.nan], memory, False)}, "controller 'go': its action holds NaN"),
        ({"act": lambda obs, memory: [0.0]}, "`act` must return action, memory, done; it returned list"),
        ({"act": lambda obs, memory: 1 / 0}, "controller 'go': ZeroDivisionError: division by zero .*test_gymnasium"),
        ({"act": lambda obs, memory: ([0.0], [], True)}, "its memory has 0 numbers; memory_size says 1"),
        ({"make_env": lambda: Line().nothing}, "make_env: AttributeError: 'Line' object has no attribute 'nothing'"),
        ({"primitives": [HeldAction("far", [3.0], 4)]}, "primitive 'far'.*outside the Box"),
        ({"primitives": [HeldAction("two", [0.0, 0.0], 4)]}, "primitive 'two': has 2 numbers, an action 1"),
        ({"primitives": [HeldAction("go", [0.0], 4)]}, "are called go"),
        ({"noise": [Noise(0.1, ["velocity"])]}, "the observation has no 'velocity'; it has: observation"),
        ({"noise": [Noise(0.1, ["observation[0:2]", "observation[1]"])]}, "must be as wide as each other"),
        ({"fields": {"x": "observation[4]"}}, r"'observation\[4\]': 'observation' has 2 numbers"),
        ({"failed": lambda info, obs: "broken"}, "says 'broken'; failure_kinds are far, terminated, truncated"),
        ({"failed": lambda info, obs: info["nothing"]}, r"failed\(info, obs\): KeyError: 'nothing'"),
        ({"state": (get_state, None)}, "give both get_state and set_state"),
        ({"processes": 0}, "0 processes given"),
        ({"failures": ()}, "failures is empty; name at least one kind"),
    ],
)  # fmt: skip
def test_what_cannot_be_a_world_is_one_message(change, told):
    with pytest.raises(ConfigError, match=told):
        line(**change)


def test_what_cannot_be_sent_to_a_process_is_one_message():
    import threading

    lock = threading.Lock()
    with pytest.raises(ConfigError, match=r"cannot be sent to a process .*lock.*make what it needs inside `make_env`"):
        line(lambda: lock and Line())


def test_an_environment_without_mujoco_needs_functions_for_its_state():
    with pytest.raises(ConfigError, match="Line: no MuJoCo model and data were found in it; give the world `get_state"):
        line(state=(None, None))


@pytest.mark.parametrize("name", ["Reacher-v5", "Pusher-v5"])
def test_mujoco_environments_of_gymnasium_are_restored_without_a_word(name):
    def act(obs, memory):
        return np.zeros(env.action_space.shape), memory + 1.0, memory[0] > 5

    env = gymnasium.make(name)
    world = GymnasiumWorld(
        name, lambda: gymnasium.make(name), [Controller("wait", act, 9, 1)], lambda info, obs: False, processes=1
    )
    assert world.control_period_s == env.unwrapped.dt
    rows = world.sample(np.random.default_rng(0), 2)
    assert not chain.run(world, world.nominal_options(), rows).success.any()


def test_a_discrete_action_is_a_primitive_too():
    class Steps(Line):
        action_space = gymnasium.spaces.Discrete(3)

        def step(self, action):
            return super().step([float(action) - 1.0])

    world = line(Steps, act=lambda obs, memory: (2, memory, obs[0] > 1.05), primitives=[HeldAction("left", [0], 3)])
    rows = world.sample(np.random.default_rng(0), 4)
    after = chain.run(world, world.primitives(), rows)
    assert (after.last.rows.sensors[:, 0] < rows.sensors[:, 0]).all()
    assert chain.run(world, world.nominal_options(), rows).success.all()


@pytest.mark.parametrize("target", ["fetch", "metaworld_sawyer", "robosuite_stack"])
def test_examples_are_known_by_what_decides_them(target):
    params = {"processes": 1} | ({"task": "drawer-open-v3"} if target == "metaworld_sawyer" else {})
    one, more = (make_world(f"examples.{target}.world:world", {**params, **rest}) for rest in ({}, {"processes": 2}))
    assert one.digest == more.digest
    noisy = make_world(f"examples.{target}.world:world", {**params, "sigma_m": 0.07})
    assert noisy.digest != one.digest


def test_named_tuples_and_ordered_dictionaries_stay_what_they_are():
    """An environment's next reset failed, since its task had become a plain tuple."""
    from p2l.worlds.gymnasium.physics import MujocoState
    from p2l.worlds.gymnasium.snapshot import pack, unpack

    env = gymnasium.make("Reacher-v5")
    env.reset(seed=0)
    inner = env.unwrapped
    inner.task, inner.tasks, inner.seen = Task("a", 1), [Task("b", 2)], OrderedDict(x=OrderedDict(z=np.zeros(2)))
    state = MujocoState(env)
    packed = pack(state.get(env))
    inner.task, inner.seen = Task("c", 3), OrderedDict(y=1)
    state.set(env, unpack(packed))
    assert inner.task == Task("a", 1)
    assert isinstance(inner.task, Task)
    assert isinstance(inner.tasks[0], Task)
    assert isinstance(inner.seen, OrderedDict)
    assert isinstance(inner.seen["x"], OrderedDict)
    assert list(inner.seen) == ["x"]


def test_who_never_answers_is_named(monkeypatch, caplog):
    monkeypatch.setattr(processes, "PATIENCE_S", 0.1)

    def slow(obs, memory):
        time.sleep(0.5 if obs[1] == 0.05 else 0.0)
        return go(obs, memory)

    world = line(act=slow, max_steps=30)
    chain.run(world, world.nominal_options(), world.sample(np.random.default_rng(0), 1), slots=1)
    assert "no answer for 0 s from 'go'" in caplog.text


def test_step_by_step_for_a_film_is_what_happens_without_one(world):
    rows = world.sample(np.random.default_rng(6), 5)
    seen = []
    plain = chain.run(world, world.nominal_options(), rows, slots=3)
    watched = chain.run(
        world, world.nominal_options(), rows, slots=3, watch=lambda episode, step, now: seen.append(len(now))
    )
    same(plain.last.rows, watched.last.rows)
    assert_array_equal(plain.last.step, watched.last.step)
    assert sum(seen) >= int(plain.last.step.sum())
