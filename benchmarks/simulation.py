"""Simulation speed: our batched engine against robosuite stepped in Python and against plain mj_step in C.

  python -m benchmarks.simulation                     every registered world
  python -m benchmarks.simulation --worlds door       one world
  python -m benchmarks.simulation --rows 32 --json out.json

Three rates in physics steps per second, measured in turns in one run (the machine is shared, so only ratios count; each
is the median over the rounds):

  ours        nominal chains over a batch of rows, observations, options and detectors included
  robosuite   robosuite's environment and OSC_POSE controller, one process, 20 Hz, objects observed, no cameras,
              replaying the actions of nominal episodes there, contacts included: its own Door and PickPlaceBread; for
              the shelves, which it lacks, `PlaceOnShelf`, written as its own are (`p2l.worlds.robosuite.shelf`)
  mj_step     the commands of our own episodes replayed with `mj_step` in C on one core, the physical limit

ratio_robosuite = ours / robosuite, ratio_limit = ours / (mj_step × threads). Worlds with a larger time step than
robosuite's 0.002 s simulate more seconds per step; `ratio_control` compares control steps per second instead.
`replayed` tells how many of the replayed episodes the environment itself calls a success; on both sides the robot errs
about the state as the world's defaults say, and an episode ends at its first flag.
"""

from __future__ import annotations

import time
from statistics import median
from typing import Any

import mujoco
import numpy as np

from benchmarks import report
from p2l.contracts.option import Option
from p2l.contracts.rows import Command, Rows
from p2l.contracts.world import World
from p2l.records import Array
from p2l.skills import chain
from p2l.skills.runner import Runner
from p2l.worlds import robosuite as robosuite_sim
from p2l.worlds.table import WORLDS, make_world

EPISODES = 6  # that robosuite replays
# At its own gains and at those of our impedance, OSC sways by some 10 mm when the arm stops, and the shelf leaves 3 mm.
# The gains cost no time; these make the replay do in robosuite what the same skills do in ours.
GAINS = {name: robosuite_sim.Gains(kp=(600.0,) * 6) for name in ("cluttered_shelf", "shelf")}


class Recorder:
    """Records the calls of the engine, so that the same commands can be replayed."""

    def __init__(self, world: World) -> None:
        self.calls: list[tuple[Array, Array, Array, Array, Any]] = []
        self._step = world.engine.step
        self._engine = world.engine

    def __enter__(self) -> Recorder:
        def step(states: Array, pos: Array, quat: Array, control: Array, index: Any) -> Any:
            self.calls.append((states.copy(), pos.copy(), quat.copy(), control.copy(), np.array(index)))
            return self._step(states, pos, quat, control, index)

        self._engine.step = step  # type: ignore[method-assign, assignment]
        return self

    def __exit__(self, *_: object) -> None:
        self._engine.step = self._step  # type: ignore[method-assign]


def ours(world: World, options: tuple[Option, ...], rows: int, seconds: float) -> float:
    """Physics steps per second of a runner whose slots are refilled; sampling is outside the time."""
    pool = world.sample(np.random.default_rng(0), 4 * rows)
    runner = Runner(world, options, rows)
    runner.start(np.arange(rows), pool.take(np.arange(rows)), np.zeros(rows, dtype=np.int64))
    next_row, steps, start = rows, 0, time.perf_counter()
    while time.perf_counter() - start < seconds:
        before = int(runner.steps_total.sum())
        events = runner.advance()
        steps += int(runner.steps_total.sum()) - before
        over = (events.reason >= 2) | (runner.option[events.slot] + 1 == len(options))
        going = events.slot[~over]
        if len(going):
            runner.begin(going, runner.option[going] + 1)
        if len(new := events.slot[over]):
            fresh = np.arange(next_row, next_row + len(new)) % len(pool)
            runner.start(new, pool.take(fresh), np.zeros(len(new), dtype=np.int64))
            next_row += len(new)
    return float(steps * world.engine.physics_steps) / (time.perf_counter() - start)


def limit(world: World, calls: list[tuple[Array, Array, Array, Array, Any]], seconds: float) -> float:
    """Physics steps per second of `mj_step` on one core over the recorded commands."""
    engine = world.engine
    data = [mujoco.MjData(model) for model in engine.models]
    steps, start, at = 0, time.perf_counter(), 0
    while time.perf_counter() - start < seconds:
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
    return steps / (time.perf_counter() - start)


class Theirs:
    """robosuite's environment of a world's task, and actions of nominal episodes for it to replay.

    Raises:
        ConfigError: robosuite has no such task, nor was one written for it.
    """

    def __init__(self, world: World, options: tuple[Option, ...]) -> None:
        self.name = robosuite_sim.task_of(world.name)
        self._transfer = robosuite_sim.make(world, tuning=GAINS.get(world.name, "matched"), objects=True)
        self.environment = self._transfer.engine.environment
        self.inner = round(self.environment.control_timestep / self.environment.model_timestep)
        self._rows = world.sample(np.random.default_rng(1), EPISODES)
        self._actions: list[list[Array]] = []
        self.success = np.zeros(EPISODES, dtype=np.bool_)  # of the last replay
        self._record(options)

    def _record(self, options: tuple[Option, ...]) -> None:
        step = self.environment.step

        def recording_step(action: Array) -> Any:
            self._actions[-1].append(action.copy())
            return step(action)

        self.environment.step = recording_step
        for episode in range(EPISODES):
            self._actions.append([])
            robosuite_sim.execute(self._transfer, options, self._rows.take([episode]))
        self.environment.step = step
        self.environment.modify_observable("wrist_force_trace", "enabled", False)  # ours, read at every physics step

    def rate(self, seconds: float) -> float:
        """Physics steps per second; going to an episode's start is outside the time."""
        steps, duration, turn = 0, 0.0, 0
        while duration < seconds or turn < EPISODES:
            episode = turn % EPISODES
            self._load(self._rows.take([episode]))
            start = time.perf_counter()
            for action in self._actions[episode]:
                self.environment.step(action)
            duration += time.perf_counter() - start
            self.success[episode] = self.environment._check_success()
            steps += len(self._actions[episode]) * self.inner
            turn += 1
        return steps / duration

    def _load(self, row: Rows) -> None:
        """Furniture, masses and sizes as the row has them; the hand open."""
        engine = self._transfer.engine
        pose = row.states[:, engine.physics_size : engine.physics_size + 7]
        engine.sense(row.states, self._transfer.control(Command.pose(pose[:, :3], pose[:, 3:], row.grip)), row.model)


def measure(name: str, rows: int, rounds: int, seconds: float, threads: int) -> report.Row:
    """All three in turns."""
    world = make_world(name, {"nthread": threads})
    options = world.nominal_options()
    with Recorder(world) as recorder:
        chain.run(world, options, world.sample(np.random.default_rng(1), 16), slots=16)
    theirs = Theirs(world, options)
    rates: dict[str, list[float]] = {"ours": [], "robosuite": [], "mj_step": []}
    for _ in range(rounds):
        rates["mj_step"].append(limit(world, recorder.calls, seconds))
        rates["ours"].append(ours(world, options, rows, seconds))
        rates["robosuite"].append(theirs.rate(seconds))
    theirs.environment.close()
    rate = {key: median(values) for key, values in rates.items()}
    control = (rate["ours"] / world.engine.physics_steps) / (rate["robosuite"] / theirs.inner)
    return {
        "world": name,
        "rows": rows,
        "threads": threads,
        "timestep_s": world.engine.timestep_s,
        **{key: round(value) for key, value in rate.items()},
        "ratio_robosuite": round(median(a / b for a, b in zip(rates["ours"], rates["robosuite"], strict=True)), 2),
        "ratio_limit": round(median(a / b / threads for a, b in zip(rates["ours"], rates["mj_step"], strict=True)), 3),
        "ratio_control": round(control, 1),
        "environment": theirs.name,
        "replayed": f"{theirs.success.sum()}/{EPISODES}",
    }


def main(arguments: list[str] | None = None) -> None:
    """Command line.

    Raises:
        ConfigError: there is no such task for robosuite.
    """
    parser = report.parser(__doc__)
    parser.add_argument("--worlds", nargs="+", type=report.known_world, default=list(WORLDS.names()))
    parser.add_argument("--rows", type=report.positive, default=256)
    parser.add_argument("--threads", type=report.positive, default=2)
    parser.add_argument("--rounds", type=report.positive, default=5)
    parser.add_argument("--seconds", type=float, default=2.0, help="of each measurement in each round")
    args = parser.parse_args(arguments)
    for name in args.worlds:
        robosuite_sim.task_of(name)  # refused now rather than after minutes
    rows = [measure(name, args.rows, args.rounds, args.seconds, args.threads) for name in args.worlds]
    report.finish(rows, args.json)


if __name__ == "__main__":
    report.command(main)
