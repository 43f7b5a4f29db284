"""Run chains of options over a batch of episodes and keep the moments at which options ended.

Axis letters: N episodes, K moments.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.records import Array, BoolArray, IntArray
from p2l.skills.runner import Reason, Runner, open_runner

FINISH = -1
Choose = Callable[["Moments"], IntArray]
Progress = Callable[[int], None]
Watch = Callable[[IntArray, IntArray, Rows], None]


@dataclass(frozen=True)
class Moments:
    """Moments at which an option ended, or was ended by a detector.

    Attributes:
        episode: [K] which episode.
        rows: [K] the state then.
        option: [K] which option ended.
        reason: [K] values of `runner.Reason`.
        kind: [K] kind of failure that was flagged while the option ran, `NO_FAILURE` where none.
        kind_step: [K] control step of the episode at which it was flagged.
        step: [K] control step of the episode.
        path_m: [K] way of the end effector so far, m.
    """

    episode: IntArray
    rows: Rows
    option: IntArray
    reason: IntArray
    kind: IntArray
    kind_step: IntArray
    step: IntArray
    path_m: Array

    def __len__(self) -> int:
        return len(self.episode)

    def take(self, index: IntArray | BoolArray) -> Moments:
        """The moments of `index`."""
        rows = np.asarray(index)
        rest = {name: getattr(self, name)[rows] for name in self.__dataclass_fields__ if name != "rows"}
        return Moments(rows=self.rows.take(rows), **rest)

    @classmethod
    def join(cls, parts: Sequence[Moments]) -> Moments:
        """All moments of `parts`, in order."""
        names = [name for name in cls.__dataclass_fields__ if name != "rows"]
        rest = {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
        return cls(rows=Rows.join([part.rows for part in parts]), **rest)


@dataclass(frozen=True)
class Execution:
    """N finished episodes.

    Attributes:
        last: [N] the last moment of each episode, in order of episodes.
        ends: [K] every option's end, ordered by episode and step; `last` included.
        success: [N] whether the goal holds at the last moment; never for a diverged row, nor, where failures stop
            an episode, for a flagged one.
        diverged: [N] episodes whose simulation broke down: to be excluded and reported.
    """

    last: Moments
    ends: Moments
    success: BoolArray
    diverged: BoolArray

    def __len__(self) -> int:
        return len(self.success)


def in_order(options: Sequence[Option]) -> Choose:
    """The plain chain: each option is followed by the next, the last by the end."""
    count = len(options)
    return lambda moments: np.where(moments.option + 1 < count, moments.option + 1, FINISH)


def run(
    world: World,
    options: Sequence[Option],
    rows: Rows,
    *,
    first: IntArray | None = None,
    muted: BoolArray | None = None,
    choose: Choose | None = None,
    stop_on_failure: bool = True,
    slots: int = 64,
    progress: Progress | None = None,
    watch: Watch | None = None,
) -> Execution:
    """Run one episode from every row.

    Args:
        world: where.
        options: the chain, or whatever `choose` picks from.
        rows: [N] where the episodes start.
        first: [N] option to start with; 0 without it.
        muted: [N] the start is a failure whose flag is still up, see `Runner.place`; none is without it.
        choose: next option after each of the moments given, `FINISH` to end the episode; the plain chain without it.
            Asked also after a timeout, and after a flag where failures do not stop an episode.
        stop_on_failure: a detector's flag ends the episode.
        slots: episodes that run at once.
        progress: called with the number of episodes finished since the last call.
        watch: called after every control step with the busy episodes, the control step of each, and their rows;
            the end of an option comes at the control step of its last motion.
    """
    count = len(rows)
    following = choose or in_order(options)
    begin = np.zeros(count, dtype=np.int64) if first is None else np.asarray(first, dtype=np.int64)
    flags_up = np.zeros(count, dtype=np.bool_) if muted is None else np.asarray(muted, dtype=np.bool_)
    runner = open_runner(world, options, min(slots, max(count, 1)), stop_on_failure=stop_on_failure)
    episode = np.full(len(runner.busy), -1, dtype=np.int64)
    parts: list[Moments] = []
    waiting = 0
    free = np.arange(len(runner.busy))
    while waiting < count or runner.busy.any():
        new = np.arange(waiting, min(waiting + len(free), count))
        if len(new):
            slots_new = free[: len(new)]
            episode[slots_new] = new
            runner.place(slots_new, rows.take(new), flags_up[new])
            runner.begin(slots_new, begin[new])
            waiting += len(new)
        busy = np.flatnonzero(runner.busy)
        events = runner.advance(by_step=watch is not None)
        if watch is not None:
            watch(episode[busy], runner.steps_total[busy], runner.rows.take(busy))
        moments = _moments(runner, episode, events.slot, events.reason, events.kind)
        if len(moments):
            parts.append(moments)
        over = (moments.reason == Reason.FAILURE) | (moments.reason == Reason.DIVERGENCE)
        nexts = np.full(len(moments), FINISH, dtype=np.int64)
        if (~over).any():
            nexts[~over] = following(moments.take(~over) if over.any() else moments)
        if (going := nexts != FINISH).any():
            runner.begin(events.slot[going], nexts[going])
        free = np.flatnonzero(~runner.busy)
        if progress is not None and (~going).any():
            progress(int((~going).sum()))
    return _execution(world, parts, count)


def _moments(runner: Runner, episode: IntArray, slot: IntArray, reason: IntArray, kind: IntArray) -> Moments:
    return Moments(
        episode=episode[slot],
        rows=runner.rows.take(slot),
        option=runner.option[slot],
        reason=reason,
        kind=kind,
        kind_step=runner.kind_step[slot],
        step=runner.steps_total[slot],
        path_m=runner.path_m[slot],
    )


def _execution(world: World, parts: Sequence[Moments], count: int) -> Execution:
    moments = Moments.join(parts)
    ends = moments.take(np.lexsort((np.arange(len(moments)), moments.episode)))
    final = np.flatnonzero(np.append(ends.episode[1:] != ends.episode[:-1], True))
    last = ends.take(final)
    diverged = last.reason == Reason.DIVERGENCE
    success = world.goal(last.rows) & ~diverged & (last.reason != Reason.FAILURE)
    if len(last) != count:
        raise AssertionError(f"{count} episodes were started and {len(last)} ended")
    return Execution(last, ends, success, diverged)
