"""Clips for videos: the nominal skills up to a failure, and a policy's recovery from it.

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
from p2l.chaining.reuse import Novel
from p2l.chaining.states import action_names
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
        captions: [T] the option or primitive at work.
        actions: options or primitives, in the order in which they started.
        ending: how it ended, in words.
        done: whether the task is done.
        flagged: whether a detector flagged a failure, which ends a nominal clip.
    """

    rows: Rows
    captions: tuple[str, ...]
    actions: tuple[str, ...]
    ending: str
    done: bool
    flagged: bool = False


def flagged_start(world: World, nominal: Sequence[Option], rng: np.random.Generator, most: int = 256) -> Rows:
    """The first of up to `most` sampled starts from which the nominal skills fail.

    Raises:
        ConfigError: none of them.
    """
    starts = world.sample(rng, most)
    for part in np.array_split(np.arange(most), max(most // 16, 1)):
        flagged = nominal_part(world, nominal, starts.take(part), slots=len(part)).last.reason == Reason.FAILURE
        if flagged.any():
            return starts.take(part[flagged][:1])
    raise ConfigError(f"none of {most} nominal runs of '{world.name}' was flagged: there is nothing to recover from")


def nominal_clip(world: World, nominal: Sequence[Option], start: Rows) -> Clip:
    """The nominal skills from `start` [1], to their end or to a detector's flag.

    Raises:
        ConfigError: the simulation breaks down.
    """
    moments: dict[int, Rows] = {0: start}

    def watch(_: IntArray, step: IntArray, rows: Rows) -> None:
        moments[int(step[0])] = rows

    execution = run(world, nominal, start, slots=1, watch=watch)
    if execution.diverged[0]:
        raise ConfigError(f"the simulation of this start of '{world.name}' breaks down; choose another")
    running = np.minimum(
        np.searchsorted(execution.ends.step, np.arange(len(moments)), side="right"), len(execution.ends) - 1
    )
    captions = tuple(f"nominal: {_plain(nominal[int(option)].name)}" for option in execution.ends.option[running])
    flagged = int(execution.last.reason[0]) == Reason.FAILURE
    ending = "task done" if execution.success[0] else "ended without success"
    if flagged:
        seconds = float(execution.last.step[0]) * world.control_period_s
        kind = _plain(world.failure_kinds[int(execution.last.kind[0])])
        ending = f"failure: {kind} in {_plain(nominal[int(execution.last.option[0])].name)} after {seconds:.1f} s"
    names = tuple(nominal[option].name for option in execution.ends.option.tolist())
    return Clip(Rows.join(list(moments.values())), captions, names, ending, bool(execution.success[0]), flagged)


def recovery_clip(world: World, nominal: Sequence[Option], agent: Agent, start: Rows) -> Clip:
    """The agent from `start` [1], to the end of its episode."""
    moments, decision_starts = [start], []

    def act(observation: Array) -> IntArray:
        decision_starts.append(len(moments))
        return agent.act(observation)

    recovery = recover(world, nominal, replace(agent, act=act), start, lambda _, rows: moments.append(rows))
    own = tuple(primitive.name for primitive in agent.primitives)
    names = [(*own, *action_names((), nominal))[action] for action in recovery.actions[0].tolist() if action >= 0]
    decision = np.searchsorted(decision_starts, np.arange(1, len(moments)), side="right")
    captions = [f"recovery {number}: {_plain(names[number - 1])}" for number in decision.tolist()]
    ending = "recovered: task done" if recovery.success[0] else "not recovered"
    return Clip(Rows.join(moments), (captions[0], *captions), tuple(names), ending, bool(recovery.success[0]))


@dataclass(frozen=True)
class PolicyClips:
    """A failure and a policy's recovery; `whole_task`: the policy acts from the start, not from the failure."""

    failure: Clip
    recovery: Clip
    whole_task: bool


def policy_clips(
    world: World,
    folder: Path,
    recorded_failure: Failures | None,
    path: Path,
    rng: np.random.Generator,
    *,
    transfer: bool,
) -> PolicyClips:
    """A failure, and the recovery by the policy in `folder`.

    Args:
        world: where.
        folder: of the policy.
        recorded_failure: one failure; None: the first that occurs in nominal runs.
        path: file of the failure, for messages.
        rng: of the nominal runs' starts.
        transfer: accept a policy of a world with other parameters.

    Raises:
        ArtifactError: a policy or a failure of another world.
        ConfigError: no detector fires.
    """
    nominal, some = world.nominal_options(), world.sample(rng, 1)
    agent, _ = load_agent(folder, world, nominal, some, transfer=transfer)  # refuses before anything is simulated
    if recorded_failure is None:
        start = flagged_start(world, nominal, rng)
    else:
        check_world(recorded_failure, world, path)
        start = recorded_failure.start
    failure = nominal_clip(world, nominal, start)
    if not failure.flagged:
        raise ConfigError(f"{path}: no detector fires on the way to this failure; a recovery has nothing to take over")
    begin = start if agent.whole_task else failure.rows.take([-1])
    return PolicyClips(failure, recovery_clip(world, nominal, agent, begin), agent.whole_task)


def novel_clips(
    world: World, nominal: Sequence[Option], agents: Mapping[int, Agents], episodes: pd.DataFrame, novel: Novel
) -> tuple[Clip, Clip]:
    """The failure before a novel reuse of an option, and the recovery that reuses it.

    Args:
        world: where.
        nominal: the chain.
        agents: by seed and learner.
        episodes: rows of `episodes.episodes_of_seed`; `novel` counts their failures.
        novel: the reuse to show.
    """
    mine = episodes[(episodes["learner"] == novel.learner) & (episodes["seed"] == novel.seed)]
    starts = start_states(world, novel.seed, len(mine))
    failure = nominal_clip(world, nominal, starts.take(np.flatnonzero(mine["flagged"])[[novel.failure]]))
    return failure, recovery_clip(world, nominal, agents[novel.seed][novel.learner][0], failure.rows.take([-1]))


def _plain(name: str) -> str:
    return name.replace("_", " ")
