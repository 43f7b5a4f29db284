"""Simulation speed: our batched engine against robosuite stepped in Python and against plain mj_step in C.

  python -m benchmarks.simulation                     every registered world
  python -m benchmarks.simulation --worlds door       one world
  python -m benchmarks.simulation --rows 32 --json out.json

Three rates in physics steps per second, measured in turns in one run (the machine is shared, so only ratios count; each
is the median over the rounds):

  ours        nominal chains over a batch of rows, observations, options and detectors included
  robosuite   robosuite's own environment and OSC_POSE controller, one process, 20 Hz, no cameras, replaying the actions
              of nominal episodes; where robosuite has no such task (the shelves) its Lift, moving about
  mj_step     the commands of our own episodes replayed with `mj_step` in C on one core, the physical limit

ratio_robosuite = ours / robosuite, ratio_limit = ours / (mj_step × threads). Worlds with a larger time step than
robosuite's 0.002 s simulate more seconds per step; `ratio_control` compares control steps per second instead.
"""

from __future__ import annotations

import time
from statistics import median
from typing import Any

import mujoco
import numpy as np

from benchmarks import report
from p2l import registry
from p2l.records import Array
from p2l.skills import chain
from p2l.skills.option import Option
from p2l.skills.runner import Runner
from p2l.worlds.world import World

ROBOSUITE = {"door": "Door", "pick_place": "PickPlaceBread"}
NEAREST = "Lift"


class Recorder:
    """Keeps what the engine is asked for while it works, so that the same commands can be replayed."""

    def __init__(self, world: World) -> None:
        self.calls: list[tuple[Array, Array, Array, Array, Any]] = []
        self._step = world.engine.step
        self._engine = world.engine

    def __enter__(self) -> Recorder:
        def step(states: Array, pos: Array, quat: Array, control: Array, index: Any) -> Any:
            self.calls.append((states.copy(), pos.copy(), quat.copy(), control.copy(), np.array(index)))
            return self._step(states, pos, quat, control, index)

        self._engine.step = step  # type: ignore[method-assign]
        return self

    def __exit__(self, *_: object) -> None:
        self._engine.step = self._step  # type: ignore[method-assign]


def ours(world: World, options: tuple[Option, ...], rows: int, seconds: float) -> float:
    """Physics steps per second of a runner whose slots are refilled; sampling is outside the time."""
    pool = world.sample(np.random.default_rng(0), 4 * rows)
    runner = Runner(world, options, rows)
    runner.start(np.arange(rows), pool.take(np.arange(rows)), np.zeros(rows, dtype=np.int64))
    taken, steps, began = rows, 0, time.perf_counter()
    while time.perf_counter() - began < seconds:
        before = int(runner.steps_total.sum())
        events = runner.advance()
        steps += int(runner.steps_total.sum()) - before
        over = (events.reason >= 2) | (runner.option[events.slot] + 1 == len(options))
        going = events.slot[~over]
        if len(going):
            runner.begin(going, runner.option[going] + 1)
        if len(new := events.slot[over]):
            fresh = np.arange(taken, taken + len(new)) % len(pool)
            runner.start(new, pool.take(fresh), np.zeros(len(new), dtype=np.int64))
            taken += len(new)
    return steps * world.engine.physics_steps / (time.perf_counter() - began)


def limit(world: World, calls: list[tuple[Array, Array, Array, Array, Any]], seconds: float) -> float:
    """Physics steps per second of `mj_step` on one core over the recorded commands."""
    engine = world.engine
    data = [mujoco.MjData(model) for model in engine.models]
    steps, began, at = 0, time.perf_counter(), 0
    while time.perf_counter() - began < seconds:
        states, pos, quat, control, index = calls[at % len(calls)]
        at += 7  # moments from all over the episodes
        for row in range(len(states)):
            model, one = engine.models[index[row]], data[index[row]]
            mujoco.mj_setState(model, one, states[row, : engine.physics_size], mujoco.mjtState.mjSTATE_FULLPHYSICS)
            for place, name in enumerate(engine.furniture, start=1):
                pose = states[row, engine.physics_size + 7 * place : engine.physics_size + 7 * place + 7]
                body = model.body(name).mocapid[0]
                one.mocap_pos[body], one.mocap_quat[body] = pose[:3], pose[3:]
            target = model.body("impedance_target").mocapid[0]
            one.mocap_pos[target], one.mocap_quat[target] = pos[row], quat[row]
            one.ctrl[:] = control[row]
            mujoco.mj_step(model, one, nstep=engine.physics_steps)
            steps += engine.physics_steps
    return steps / (time.perf_counter() - began)


class Theirs:
    """robosuite's own environment with its own controller, and something for it to do.

    Where it has the task it replays the actions of nominal episodes there, contacts included; else (the shelves) its
    Lift moves about at random, mostly in free space, which is the cheaper half of such a task.
    """

    def __init__(self, world: World, options: tuple[Option, ...]) -> None:
        self.name = ROBOSUITE.get(world.name, NEAREST)
        self._starts: list[Array] = []
        self._actions: list[list[Array]] = []
        if world.name in ROBOSUITE:
            self._record(world, options)
        else:
            self._wander()
        self.inner = round(self.environment.control_timestep / self.environment.model_timestep)

    def _record(self, world: World, options: tuple[Option, ...]) -> None:
        from p2l.evaluation import robosuite_sim

        transfer = robosuite_sim.make(world)
        self.environment = transfer.engine.environment
        step = self.environment.step

        def kept(action: Array) -> Any:
            self._actions[-1].append(action.copy())
            if len(self._actions[-1]) == 1:
                self._starts.append(self.environment.sim.get_state().flatten())
            return step(action)

        self.environment.step = kept
        rows = world.sample(np.random.default_rng(1), 6)
        for episode in range(len(rows)):
            self._actions.append([])
            robosuite_sim.execute(transfer, options, rows.take([episode]), stop_on_failure=False)
        self.environment.step = step
        self.environment.modify_observable("wrist_force_trace", "enabled", False)  # ours, read at every physics step

    def _wander(self) -> None:
        import robosuite

        self.environment = robosuite.make(
            self.name,
            robots="Panda",
            has_renderer=False,
            has_offscreen_renderer=False,
            use_camera_obs=False,
            control_freq=20,
            ignore_done=True,
            controller_configs=robosuite.load_composite_controller_config(robot="Panda"),
        )
        self.environment.reset()
        low, high = self.environment.action_spec
        rng = np.random.default_rng(0)
        self._starts.append(self.environment.sim.get_state().flatten())
        self._actions.append([0.2 * rng.uniform(low, high) for _ in range(100)])

    def rate(self, seconds: float) -> float:
        """Physics steps per second; restoring an episode's start is outside the time."""
        steps, spent, episode = 0, 0.0, 0
        while spent < seconds:
            sim = self.environment.sim
            sim.set_state_from_flattened(self._starts[episode % len(self._starts)])
            sim.forward()
            actions = self._actions[episode % len(self._actions)]
            began = time.perf_counter()
            for action in actions:
                self.environment.step(action)
            spent += time.perf_counter() - began
            steps += len(actions) * self.inner
            episode += 1
        return steps / spent


def measure(name: str, rows: int, rounds: int, seconds: float, threads: int) -> report.Row:
    """All three in turns."""
    world = registry.get_world(name, {"nthread": threads})
    options = registry.get_options(name, world)
    with Recorder(world) as recorder:
        chain.run(world, options, world.sample(np.random.default_rng(1), 16), slots=16)
    theirs = Theirs(world, options)
    taken: dict[str, list[float]] = {"ours": [], "robosuite": [], "mj_step": []}
    for _ in range(rounds):
        taken["mj_step"].append(limit(world, recorder.calls, seconds))
        taken["ours"].append(ours(world, options, rows, seconds))
        taken["robosuite"].append(theirs.rate(seconds))
    theirs.environment.close()
    rate = {key: median(values) for key, values in taken.items()}
    control = (rate["ours"] / world.engine.physics_steps) / (rate["robosuite"] / theirs.inner)
    return {
        "world": name,
        "rows": rows,
        "threads": threads,
        "timestep_s": world.engine.timestep_s,
        **{key: round(value) for key, value in rate.items()},
        "ratio_robosuite": round(median(a / b for a, b in zip(taken["ours"], taken["robosuite"], strict=True)), 2),
        "ratio_limit": round(median(a / b / threads for a, b in zip(taken["ours"], taken["mj_step"], strict=True)), 3),
        "ratio_control": round(control, 1),
        "environment": theirs.name,
    }


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = report.parser(__doc__)
    parser.add_argument("--worlds", nargs="+", choices=registry.known_worlds(), default=list(registry.known_worlds()))
    parser.add_argument("--rows", type=int, default=256)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--seconds", type=float, default=2.0, help="of each measurement in each round")
    given = parser.parse_args(arguments)
    rows = [measure(name, given.rows, given.rounds, given.seconds, given.threads) for name in given.worlds]
    report.finish(rows, given.json)


if __name__ == "__main__":
    main()
