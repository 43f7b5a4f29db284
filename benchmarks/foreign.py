"""Control steps per second of others' environments as worlds, beside the bare environments, in one run.

  python -m benchmarks.foreign                    Fetch, Meta-World, robosuite
  python -m benchmarks.foreign --worlds fetch     one of them

`alone` is `env.step` in one process and nothing else; `bare` the same in as many processes at once; `ours` a nominal
chain of the world, controllers, detectors and states included. The three are measured in turn, several times, since a
shared machine changes its pace within a minute. `share` is ours of alone × processes, `share_bare` ours of bare:
medians of the rounds, with the lowest and the highest. `copies` are copies of a whole state per control step,
`copies_within` those made while an option goes on.
"""

from __future__ import annotations

import functools
import importlib
import multiprocessing
import time
from functools import partial
from typing import Any

import numpy as np

from benchmarks import report
from p2l.contracts.rows import Rows
from p2l.skills import chain
from p2l.worlds.gymnasium import Controller, GymnasiumWorld

WORLDS = {
    "fetch": ("examples.fetch.world", {}),
    "drawer_open": ("examples.metaworld_sawyer.world", {"task": "drawer-open-v3"}),
    "stack": ("examples.robosuite_stack.world", {}),
}
_CHAIN = 4  # options of an episode
_SLOTS, _ROWS = 16, 64


def make_env(name: str) -> Any:
    """A bare environment."""
    module, params = WORLDS[name]
    return importlib.import_module(module).make_env(*params.values())


def wait(size: int, steps: int, obs: Any, memory: Any) -> tuple[Any, Any, bool]:  # noqa: ARG001
    """Nothing, for a while."""
    return np.zeros(size), memory + 1.0, bool(memory[0] >= steps)


@functools.cache
def _kept(name: str) -> Any:
    """The process's own."""
    return make_env(name)


def bare(name: str, seconds: float, option_steps: int) -> float:
    """`env.step` per second."""
    env = _kept(name)
    env.reset(seed=0)
    action, steps = np.zeros(env.action_space.shape, dtype=env.action_space.dtype), 0
    for _ in range(20):
        env.step(action)
    start = time.perf_counter()
    while time.perf_counter() - start < seconds:
        for _ in range(10):
            env.step(action.copy())
        steps += 10
        if steps % (_CHAIN * option_steps) == 0:
            begin = time.perf_counter()
            env.reset(seed=steps)
            start += time.perf_counter() - begin
    return steps / (time.perf_counter() - start)


def never(info: Any, obs: Any) -> bool:  # noqa: ARG001
    """The task has no end."""
    return False


def foreign_world(name: str, option_steps: int, processes: int) -> GymnasiumWorld:
    """The environment as a world whose controllers wait."""
    size = int(np.prod(make_env(name).action_space.shape))
    controllers = [
        Controller(f"wait {k}", partial(wait, size, option_steps), 2 * option_steps, 1) for k in range(_CHAIN)
    ]
    return GymnasiumWorld(name, partial(make_env, name), controllers, never, processes=processes)


def ours(world: GymnasiumWorld, rows: Rows, seconds: float) -> tuple[float, int, int, int]:
    """Control steps per second of a world; control steps, options and copies of states."""
    before, steps, options, start = world.processes.copies(), 0, 0, time.perf_counter()
    while time.perf_counter() - start < seconds:
        execution = chain.run(world, world.nominal_options(), rows, slots=_SLOTS)
        steps, options = steps + int(execution.last.step.sum()), options + len(execution.ends)
    rate = steps / (time.perf_counter() - start)
    return rate, steps, options, world.processes.copies() - before


def measure(name: str, seconds: float, option_steps: int, processes: int, rounds: int) -> report.Row:
    """One environment."""
    world = foreign_world(name, option_steps, processes)
    rows = world.sample(np.random.default_rng(0), _ROWS)
    chain.run(world, world.nominal_options(), rows, slots=_SLOTS)
    alone, together, mine, steps, options, copies = [], [], [], 0, 0, 0
    with multiprocessing.get_context("spawn").Pool(processes) as pool:
        for _ in range(rounds):
            alone.append(pool.apply(bare, (name, seconds, option_steps)))
            together.append(sum(pool.starmap(bare, [(name, seconds, option_steps)] * processes, chunksize=1)))
            rate, more_steps, more_options, more_copies = ours(world, rows, seconds)
            mine.append(rate)
            steps, options, copies = steps + more_steps, options + more_options, copies + more_copies
    share, share_bare = np.array(mine) / (processes * np.array(alone)), np.array(mine) / np.array(together)
    return {
        "world": name,
        "processes": processes,
        "option_steps": option_steps,
        "alone": round(float(np.median(alone)), 1),
        "bare": round(float(np.median(together)), 1),
        "ours": round(float(np.median(mine)), 1),
        "share": round(float(np.median(share)), 3),
        "lowest": round(float(share.min()), 3),
        "highest": round(float(share.max()), 3),
        "share_bare": round(float(np.median(share_bare)), 3),
        "copies": round(copies / steps, 4),
        "copies_within": max(0, copies - 2 * options) / steps,
    }


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = report.parser(__doc__)
    parser.add_argument("--worlds", nargs="+", choices=sorted(WORLDS), default=list(WORLDS))
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--option-steps", type=int, nargs="+", default=[50, 100], help="control steps of an option")
    parser.add_argument("--seconds", type=float, default=2.0, help="of each measurement")
    parser.add_argument("--rounds", type=int, default=5, help="measurements of each kind, in turn")
    args = parser.parse_args(arguments)
    rows = [
        measure(name, args.seconds, steps, args.processes, args.rounds)
        for name in args.worlds
        for steps in args.option_steps
    ]
    report.finish(rows, args.json)


if __name__ == "__main__":
    report.command(main)
