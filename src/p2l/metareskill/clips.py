"""Executions to be looked at: the way into a failure mode, and what the robot does there with its recoveries.

The failure is a held-out one, the most typical of its mode among those that training could have met. What follows is
what the robot does there knowing the state: recoveries and nominal skills, to the goal or to where it gives up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from p2l.contracts.rows import Rows
from p2l.failures.discovery import replay
from p2l.failures.record import Failures
from p2l.metareskill.record import Recoveries
from p2l.metareskill.setting import Setting
from p2l.metareskill.strategies import Playbook, playbook
from p2l.records import BoolArray, IntArray
from p2l.seeding import generator
from p2l.skills.chain import FINISH, Moments, run
from p2l.skills.execute import without_noise


@dataclass(frozen=True)
class ModeClips:
    """One clip of each failure mode that has a held-out failure, before learning and after.

    Attributes:
        modes: numbers of the modes.
        kinds: what failed, in words.
        before: the way to the failure, a row per control step.
        after: from there, with the recoveries; the failure alone where the robot gives up at once.
        skills: names of the skills executed after it.
        solved: whether the goal was reached.
    """

    modes: tuple[int, ...]
    kinds: tuple[str, ...]
    before: Sequence[Rows]
    after: Sequence[Rows]
    skills: Sequence[Sequence[str]]
    solved: tuple[bool, ...]


def mode_clips(setting: Setting, failures: Failures, recoveries: Recoveries) -> ModeClips:
    """Execute one failure of each mode, and what follows it.

    Args:
        setting: world, preconditions and modes.
        failures: held out.
        recoveries: learnt.
    """
    modes, typical = _typical(setting, failures)
    world = setting.task.world
    kinds = zip(typical.kind_names(), typical.option_names(), strict=True)
    after, skills, solved = _ways_out(setting, typical, recoveries)
    return ModeClips(
        modes=tuple(modes.tolist()),
        kinds=tuple(f"{kind} in {option}" for kind, option in kinds),
        before=replay(world, world.nominal_options(), typical),
        after=after,
        skills=skills,
        solved=tuple(solved.tolist()),
    )


def _typical(setting: Setting, failures: Failures) -> tuple[IntArray, Failures]:
    """The modes that have a held-out failure in which no precondition holds, and the likeliest such one of each."""
    mode, probability = setting.modes.classify(failures.truth)
    lost = np.flatnonzero(~setting.task.holds(failures.rows).any(axis=1))
    modes = np.unique(mode[lost])
    best = [lost[mode[lost] == each][probability[lost[mode[lost] == each]].argmax()] for each in modes.tolist()]
    return modes, failures.take(np.array(best, dtype=np.int64))


def _ways_out(
    setting: Setting, failures: Failures, recoveries: Recoveries
) -> tuple[list[Rows], list[list[str]], BoolArray]:
    """From each failure: rows of every control step, names of the skills executed, and whether the goal is reached."""
    task = setting.task
    nominal = task.world.nominal_options()
    limit = setting.failures.rows.actions.max() + len(nominal) + 4

    def book() -> Playbook:
        rng, skills = generator(0, "videos", "ties"), recoveries.skills
        graph, timing, modes = recoveries.graph, recoveries.timing, setting.modes
        return playbook("recoveries", task, nominal, graph, timing, rng, modes=modes, skills=skills, max_options=limit)

    rows = without_noise(failures.rows)
    count = len(rows)
    nothing = np.zeros(count, dtype=np.int64)
    moments = Moments(np.arange(count), rows, failures.option, nothing, nothing - 1, nothing, nothing, np.zeros(count))
    first, policy = book().choose(moments), book()  # one that remembers the episodes as they are numbered in its run
    going = np.flatnonzero(first != FINISH)
    paths = [[rows.take([index])] for index in range(count)]
    names: list[list[str]] = [[] for _ in range(count)]
    solved = np.zeros(count, dtype=np.bool_)
    if not len(going):
        return [Rows.join(path) for path in paths], names, solved

    def watch(episode: IntArray, _step: IntArray, now: Rows) -> None:
        for place, index in enumerate(episode.tolist()):
            paths[going[index]].append(now.take([place]))

    execution = run(
        task.world, policy.options, rows.take(going), first=first[going], choose=policy.choose, stop_on_failure=False,
        slots=len(going), watch=watch,
    )  # fmt: skip
    for episode, option in zip(execution.ends.episode.tolist(), execution.ends.option.tolist(), strict=True):
        names[going[episode]].append(policy.options[option].name)
    solved[going] = execution.success
    return [Rows.join(path) for path in paths], names, solved
