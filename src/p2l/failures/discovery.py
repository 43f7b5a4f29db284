"""Failures of the nominal skills, found by running them under uncertainty (thesis, sections 4.3.1 and 5.4).

Three strategies:
- `pessimistic`: open loop under the initial uncertainty, one estimate for the whole chain, which goes on after failing.
  At every option's end the state is a failure if no option's precondition holds on the truth and the goal does not.
- `early_termination`: the estimator improves after every action, and the episode ends at the first such state.
- `first_flag`: the episode ends when a failure detector speaks, and that moment is the failure.

Where the thesis is silent:
1. Early termination: after an option that did not end in failure, the robot takes the option nearest to the goal whose
   precondition holds on the truth, as the thesis's high-level policy does (section 4.2.1), up to `max_options`.
2. An episode whose simulation breaks down is left out with all its moments, and counted.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import NO_FAILURE, World
from p2l.errors import ConfigError
from p2l.failures.record import STRANDED, Failures, Origin
from p2l.failures.strategy import STRATEGIES
from p2l.records import BoolArray, IntArray
from p2l.skills.chain import FINISH, Choose, Execution, Moments, Progress, Watch, in_order, run
from p2l.skills.runner import Reason

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Discovery:
    """One split of discovery.

    Attributes:
        failures: N of them.
        execution: all episodes.
    """

    failures: Failures
    execution: Execution


def find_failures(
    world: World,
    options: Sequence[Option],
    starts: Rows,
    origin: Origin,
    *,
    slots: int = 64,
    progress: Progress | None = None,
) -> Discovery:
    """Run one episode from each of `starts` by the strategy of `origin`, and keep the failures.

    Episodes whose simulation breaks down are left out, and a warning counts them.

    Args:
        world: made with the strategy's estimator, see `strategy.ESTIMATORS`.
        options: its nominal chain.
        starts: start states.
        origin: names the strategy; goes into the record.
        slots: episodes at once.
        progress: called with the number of episodes finished since the last call.
    """
    execution = _run(world, options, starts, origin, slots=slots, progress=progress)
    if diverged := int(execution.diverged.sum()):
        where = world.name, origin.split, diverged, len(execution)
        log.warning("%s %s: the simulation of %d of %d episodes broke down; left out", *where)
    moments = execution.ends.take(_is_failure(world, options, execution, origin.strategy))
    return Discovery(_record(world, starts, moments, origin), execution)


def replay(world: World, options: Sequence[Option], failures: Failures) -> list[Rows]:
    """The way to each failure, from the start of its episode: rows of every control step, the start included.

    Ends with the recorded moment; where this machine does not compute as the one that recorded it, a warning says so.
    """
    path = _Path(failures.start)
    _run(world, options, failures.start, failures.origin, slots=len(failures), watch=path.watch)
    for index, step in enumerate(failures.step.tolist()):
        moment = failures.rows.take([index])
        again = path.rows[index].get(step)
        if again is None or not np.array_equal(again.states, moment.states):
            log.warning("failure of episode %d: the replay ends elsewhere than recorded", failures.episode[index])
        path.rows[index][step] = moment
    return [path.until(index, int(step)) for index, step in enumerate(failures.step)]


def nominal_run(world: World, options: Sequence[Option], start: Rows) -> tuple[Rows, bool]:
    """The plain chain from one start: rows of every control step, and whether the goal is reached."""
    path = _Path(start)
    execution = run(world, options, start, stop_on_failure=False, slots=1, watch=path.watch)
    return path.until(0, int(execution.last.step[0])), bool(execution.success[0])


class _Path:
    """Rows by control step of a few episodes, as `chain.run` reports them."""

    def __init__(self, start: Rows) -> None:
        self.rows: list[dict[int, Rows]] = [{0: start.take([index])} for index in range(len(start))]

    def watch(self, episode: IntArray, step: IntArray, rows: Rows) -> None:
        """Keep a moment of each episode."""
        for place, (index, now) in enumerate(zip(episode.tolist(), step.tolist(), strict=True)):
            self.rows[index][now] = rows.take([place])

    def until(self, index: int, last: int) -> Rows:
        """One episode's rows up to a control step."""
        return Rows.join([row for step, row in sorted(self.rows[index].items()) if step <= last])


def stranded(world: World, options: Sequence[Option], rows: Rows) -> BoolArray:
    """[N] no nominal precondition holds on the truth, and the task is not done."""
    return ~_ready(world, options, rows).any(axis=1) & ~world.goal(rows)


def _ready(world: World, options: Sequence[Option], rows: Rows) -> BoolArray:
    truth = world.privileged(rows)
    return np.stack([option.precondition(truth) for option in options], axis=1)


def _run(
    world: World,
    options: Sequence[Option],
    starts: Rows,
    origin: Origin,
    *,
    slots: int,
    progress: Progress | None = None,
    watch: Watch | None = None,
) -> Execution:
    if origin.strategy not in STRATEGIES:
        raise ConfigError(f"unknown strategy of discovery '{origin.strategy}'; known: {', '.join(STRATEGIES)}")
    early = origin.strategy == "early_termination"
    choose = nearest_goal(world, options, origin.max_options) if early else in_order(options)
    stop, slots = origin.strategy == "first_flag", max(slots, 1)
    return run(world, options, starts, choose=choose, stop_on_failure=stop, slots=slots, progress=progress, watch=watch)


def nearest_goal(world: World, options: Sequence[Option], max_options: int) -> Choose:
    """The last option of the chain whose precondition holds on the truth; the end if none does or the task is done."""

    def choose(moments: Moments) -> IntArray:
        ready = _ready(world, options, moments.rows)
        last = ready.shape[1] - 1 - np.argmax(ready[:, ::-1], axis=1)
        over = ~ready.any(axis=1) | world.goal(moments.rows) | (moments.rows.actions >= max_options)
        return np.where(over, FINISH, last)

    return choose


def _is_failure(world: World, options: Sequence[Option], execution: Execution, strategy: str) -> BoolArray:
    """[K] of the options' ends: whether it is a failure."""
    ends = execution.ends
    sound = ~execution.diverged[ends.episode]
    if strategy == "first_flag":
        return np.asarray(sound & (ends.reason == Reason.FAILURE))
    failure = np.zeros(len(ends), dtype=np.bool_)
    failure[sound] = stranded(world, options, ends.rows.take(sound))
    return failure


def _record(world: World, starts: Rows, moments: Moments, origin: Origin) -> Failures:
    return Failures(
        origin=origin,
        start=starts.take(moments.episode),
        rows=moments.rows,
        truth=world.privileged(moments.rows),
        seen=world.observe(moments.rows),
        option=moments.option,
        kind=np.where(moments.kind == NO_FAILURE, origin.kinds.index(STRANDED), moments.kind),
        step=moments.step,
        time_s=np.round(moments.step * world.control_period_s, 6),
        episode=moments.episode,
    )
