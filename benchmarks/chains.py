"""What learning where and how to recover costs: training beside the bare engine.

  python -m benchmarks.chains                                     RecoveryChaining on pick-place and on the shelf
  python -m benchmarks.chains --worlds shelf --version 2           a version of our worlds other than their default
  python -m benchmarks.chains --worlds shelf --learners rc pp --json out.json

Each learner trains for `--budget` control steps with the settings of `conf/`, from failures of fresh nominal executions
(`rl` from the task's start): policy, options, detectors, rewards and PPO's updates included; evaluations and
checkpoints are not. `engine_s` replays the very commands of that training with plain engine calls, so `engine_share` =
engine_s / train_s is the part of the engine's throughput that training uses. `update_share` is the part of train_s that
PPO's updates take, `rows` how many episodes an engine call moves on average, and `half_million_min` how long 500,000
control steps take at this rate.

The machine is shared: figures are medians over `--rounds`, and only ratios of one run mean much.
"""

from __future__ import annotations

import time
from pathlib import Path
from statistics import median

import numpy as np
import torch
from omegaconf import DictConfig, OmegaConf

from benchmarks import report
from benchmarks.simulation import Recorder
from p2l.chaining.learner import ChainTask
from p2l.chaining.learners.table import LEARNERS, make_learner
from p2l.chaining.mdp import Limits
from p2l.chaining.ppo import PoolPPO, PPOSettings
from p2l.chaining.train import card_of
from p2l.contracts.world import NO_FAILURE
from p2l.errors import ConfigError
from p2l.skills import chain
from p2l.worlds.table import make_world

CONF = Path(__file__).resolve().parents[1] / "conf"
STARTS = 400  # nominal executions, to find failures


class TimedPPO(PoolPPO):
    """PPO that measures the time of its updates."""

    update_s = 0.0

    def train(self) -> None:
        """One update."""
        start = time.perf_counter()
        super().train()
        self.update_s += time.perf_counter() - start


def settings(world: str) -> DictConfig:
    """Those of `conf/` for a world."""
    defaults, own = OmegaConf.load(CONF / "chain_recoveries.yaml"), CONF / "chaining" / f"{world}.yaml"
    return OmegaConf.merge(defaults, OmegaConf.load(own)) if own.is_file() else defaults  # type: ignore[return-value]


def chain_task(name: str, threads: int, version: int | None = None) -> ChainTask:
    """A world with failures at the detectors' first flag.

    Args:
        name: of the world.
        threads: of its simulator.
        version: of our worlds, see `worlds.physics.VERSIONS`; the world's default without any.

    Raises:
        ConfigError: there are none.
    """
    world = make_world(name, {"nthread": threads} | ({} if version is None else {"version": version}))
    nominal = world.nominal_options()
    last = chain.run(world, nominal, world.sample(np.random.default_rng(0), STARTS)).last
    failures = last.take(last.kind != NO_FAILURE).rows
    if not len(failures):
        raise ConfigError(f"{STARTS} nominal executions of world '{name}' raised no flag; choose another world")
    return ChainTask(world, nominal, failures, 0)


def train(task: ChainTask, name: str, budget: int) -> tuple[TimedPPO, float]:
    """A training always by the same seed, and its wall time; what comes before it is outside the time."""
    config = settings(task.world.name)
    learner = make_learner(name, task, Limits(**config.limits))
    pool = learner.pool(task, np.random.default_rng(0), config.slots, config.revisit)
    normalisation = card_of(task, learner, name, "", config.narrowest).normalisation
    running = learner.running_normalisation
    model = TimedPPO(pool, PPOSettings(**config.ppo), normalisation, 0, learner.shortcut, running=running)
    start = time.perf_counter()
    model.learn(budget, log_interval=10**9)
    return model, time.perf_counter() - start


def measure(name: str, learner: str, budget: int, rounds: int, threads: int, version: int | None = None) -> report.Row:
    """Training and replay in turns."""
    task = chain_task(name, threads, version)
    with Recorder(task.world) as recorder:
        train(task, learner, budget)
    # Preconditions and the first states, learnt before training begins, are recorded first; the budget ends the rest.
    calls, rows = [], 0
    for call in reversed(recorder.calls):
        if rows >= budget:
            break
        calls.append(call)
        rows += len(call[0])
    calls.reverse()
    measurements: list[tuple[float, float, float, int]] = []
    for _ in range(rounds):
        model, seconds = train(task, learner, budget)
        start = time.perf_counter()
        for call in calls:
            task.world.engine.step(*call)
        replay = (time.perf_counter() - start) * model.num_timesteps / rows
        measurements.append((seconds, replay, model.update_s, model.num_timesteps))
    return {
        "world": name,
        "learner": learner,
        "control_steps": measurements[0][3],
        "rows": round(rows / len(calls), 1),
        "threads": threads,
        "train_s": round(median(one[0] for one in measurements), 2),
        "engine_s": round(median(one[1] for one in measurements), 2),
        "engine_share": round(median(one[1] / one[0] for one in measurements), 3),
        "update_share": round(median(one[2] / one[0] for one in measurements), 3),
        "control_steps_per_s": round(median(one[3] / one[0] for one in measurements)),
        "half_million_min": round(median(one[0] / one[3] for one in measurements) * 500_000 / 60, 2),
    }


def main(arguments: list[str] | None = None) -> None:
    """Command line.

    Raises:
        ConfigError: the nominal skills of a world raise no flag.
    """
    parser = report.parser(__doc__)
    parser.add_argument("--worlds", nargs="+", type=report.known_world, default=["pick_place", "shelf"])
    parser.add_argument("--learners", nargs="+", choices=LEARNERS.names(), default=["rc"])
    parser.add_argument("--budget", type=report.positive, default=15_000, help="control steps")
    parser.add_argument("--threads", type=report.positive, default=2)
    parser.add_argument("--rounds", type=report.positive, default=3)
    parser.add_argument("--version", type=report.positive, help="of our worlds; the world's default without it")
    args = parser.parse_args(arguments)
    torch.set_num_threads(1)  # as in training
    rows = [
        measure(world, learner, args.budget, args.rounds, args.threads, args.version)
        for world in args.worlds
        for learner in args.learners
    ]
    report.finish(rows, args.json)


if __name__ == "__main__":
    report.command(main)
