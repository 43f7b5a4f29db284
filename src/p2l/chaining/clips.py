"""Executions to be looked at: a nominal failure, and what a learnt recovery does about it.

Axis letters: T control steps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from p2l.chaining.agent import Agent, load_agent
from p2l.chaining.episodes import Agents, start_states
from p2l.chaining.execute import nominal_part, recover
from p2l.chaining.pool import action_names
from p2l.chaining.reuse import Novel
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.errors import ConfigError
from p2l.failures.record import Failures, check_world
from p2l.records import Array, IntArray
from p2l.skills.chain import run
from p2l.skills.runner import Reason


@dataclass(frozen=True)
class Clip:
    """A part of an execution.

    Attributes:
        rows: [T] its moments.
        captions: [T] what is being done.
        actions: options or primitives that were begun, in order.
        told: how it ended.
        done: whether the task is done.
        flagged: whether a detector ended it.
    """

    rows: Rows
    captions: tuple[str, ...]
    actions: tuple[str, ...]
    told: str
    done: bool
    flagged: bool = False


def flagged_start(world: World, nominal: Sequence[Option], rng: np.random.Generator, most: int = 256) -> Rows:
    """The first of up to `most` drawn starts from which a detector fires.

    Raises:
        ConfigError: none of them.
    """
    starts = world.sample(rng, most)
    for part in np.array_split(np.arange(most), max(most // 16, 1)):
        flagged = nominal_part(world, nominal, starts.take(part), slots=len(part)).last.reason == Reason.FAILED
        if flagged.any():
            return starts.take(part[flagged][:1])
    raise ConfigError(f"none of {most} nominal runs of '{world.name}' was flagged: there is nothing to recover from")


def nominal_clip(world: World, nominal: Sequence[Option], start: Rows) -> Clip:
    """The nominal skills from `start` [1], to their end or to where a detector fires.

    Raises:
        ConfigError: the simulation breaks down.
    """
    kept: dict[int, Rows] = {0: start}

    def watch(_: IntArray, step: IntArray, rows: Rows) -> None:
        kept[int(step[0])] = rows

    done = run(world, nominal, start, slots=1, watch=watch)
    if done.diverged[0]:
        raise ConfigError(f"the simulation of this start of '{world.name}' breaks down; choose another")
    running = np.minimum(np.searchsorted(done.ends.step, np.arange(len(kept)), side="right"), len(done.ends) - 1)
    captions = tuple(f"nominal: {_plain(nominal[int(option)].name)}" for option in done.ends.option[running])
    failed = int(done.last.reason[0]) == Reason.FAILED
    told = "task done" if done.success[0] else "ended without success"
    if failed:
        seconds = float(done.last.step[0]) * world.engine.control_period_s
        kind = _plain(world.failure_kinds[int(done.last.kind[0])])
        told = f"failure: {kind} in {_plain(nominal[int(done.last.option[0])].name)} after {seconds:.1f} s"
    names = tuple(nominal[option].name for option in done.ends.option.tolist())
    return Clip(Rows.join(list(kept.values())), captions, names, told, bool(done.success[0]), failed)


def recovery_clip(world: World, nominal: Sequence[Option], agent: Agent, start: Rows) -> Clip:
    """The agent from `start` [1], to the end of its episode."""
    kept, begun = [start], []

    def act(observation: Array) -> IntArray:
        begun.append(len(kept))
        return agent.act(observation)

    found = recover(world, nominal, replace(agent, act=act), start, lambda _, rows: kept.append(rows))
    own = tuple(primitive.name for primitive in agent.primitives)
    names = [(*own, *action_names((), nominal))[action] for action in found.actions[0].tolist() if action >= 0]
    decision = np.searchsorted(begun, np.arange(1, len(kept)), side="right")
    captions = [f"recovery {number}: {_plain(names[number - 1])}" for number in decision.tolist()]
    told = "recovered: task done" if found.success[0] else "not recovered"
    return Clip(Rows.join(kept), (captions[0], *captions), tuple(names), told, bool(found.success[0]))


@dataclass(frozen=True)
class PolicyClips:
    """A failure and what a policy does about it; `whole_task`: the policy acts from the start, not from the failure."""

    failure: Clip
    recovery: Clip
    whole_task: bool


def policy_clips(
    world: World, folder: Path, recorded: Failures | None, path: Path, rng: np.random.Generator, *, transfer: bool
) -> PolicyClips:
    """A failure, and what the policy in `folder` does about it.

    Args:
        world: where.
        folder: of the policy.
        recorded: one failure; None: the first that nominal runs meet.
        path: where it lies, for messages.
        rng: of the nominal runs' starts.
        transfer: the world may have other parameters than the one the policy was learnt in.

    Raises:
        ArtifactError: a policy or a failure of another world.
        ConfigError: no detector fires.
    """
    nominal, some = world.nominal_options(), world.sample(rng, 1)
    agent, _ = load_agent(folder, world, nominal, some, transfer=transfer)  # refuses before anything is simulated
    if recorded is None:
        start = flagged_start(world, nominal, rng)
    else:
        check_world(recorded, world, path)
        start = recorded.start
    failure = nominal_clip(world, nominal, start)
    if not failure.flagged:
        raise ConfigError(f"{path}: no detector fires on the way to this failure; a recovery has nothing to take over")
    begin = start if agent.whole_task else failure.rows.take([-1])
    return PolicyClips(failure, recovery_clip(world, nominal, agent, begin), agent.whole_task)


def novel_clips(
    world: World, nominal: Sequence[Option], agents: Mapping[int, Agents], episodes: pd.DataFrame, novel: Novel
) -> tuple[Clip, Clip]:
    """The failure before a novel reuse of an option, and the recovery that reused it.

    Args:
        world: where.
        nominal: the chain.
        agents: by seed and learner.
        episodes: of `episodes.episodes_of_seed`, in which the failures are.
        novel: which.
    """
    mine = episodes[(episodes["learner"] == novel.learner) & (episodes["seed"] == novel.seed)]
    starts = start_states(world, novel.seed, len(mine))
    failure = nominal_clip(world, nominal, starts.take(np.flatnonzero(mine["flagged"])[[novel.failure]]))
    return failure, recovery_clip(world, nominal, agents[novel.seed][novel.learner][0], failure.rows.take([-1]))


def _plain(name: str) -> str:
    return name.replace("_", " ")
