"""Preconditions of the nominal controllers over deployable observations, fitted offline.

For the baseline that learns to reach them (thesis, section 5.3.3): control steps of nominal runs are states in which
the running controller may be started, recorded failures are states in which any of them may.

1. The number of actions so far is left out: in nominal runs it is the number of the controller, so that a recovery,
   which has taken more actions, would never meet a precondition.
2. A state is labelled by starting its controller there, not by how the run ended that it is taken from: a controller
   under way is in a phase that one started anew has still to come to, and often cannot.
3. The failures are those of training. They cost little, since most starts there fail within a few control steps, and
   without them the classifiers would know nothing of the places where an episode begins.
4. The threshold is calibrated: on held-out runs and failures, started at the controller that scores best, as a recovery
   does. The simulation is offline data, which no learner's budget is charged for; its control steps are reported.

Axis letters: K rows, O observation columns, F features, I nominal controllers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.chaining.certainty import certain_from
from p2l.contracts.observation import Observation
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.errors import ConfigError
from p2l.preconditions.classifier import PreconditionClassifier, fit_classifier
from p2l.records import Array, BoolArray, IntArray
from p2l.skills.chain import run

COUNTER = "actions"
SUPPORT = 20  # held-out states above a calibrated threshold, at least


@dataclass(frozen=True)
class ControllerPreconditions:
    """One classifier for each nominal controller.

    Attributes:
        classifiers: I of them, over the same features.
        columns: [F] which columns of an observation those are.
        threshold: probability from which a precondition holds.
    """

    classifiers: tuple[PreconditionClassifier, ...]
    columns: IntArray
    threshold: float

    def score(self, observation: Array) -> Array:
        """[K, I] probabilities from [K, O] observations."""
        return np.stack([one.probability(observation[:, self.columns]) for one in self.classifiers], axis=1)

    def holds(self, observation: Array) -> BoolArray:
        """[K] whether one of them holds."""
        return np.asarray(self.score(observation).max(axis=1) >= self.threshold)

    def best(self, observation: Array) -> IntArray:
        """[K] the controller most likely to succeed."""
        return np.asarray(self.score(observation).argmax(axis=1))

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """For `artifacts.save_arrays`."""
        parts = {f"{i}.{key}": value for i, one in enumerate(self.classifiers) for key, value in one.arrays().items()}
        rest = {
            "threshold": np.array(self.threshold),
            "count": np.array(len(self.classifiers)),
            "columns": self.columns,
        }
        return parts | rest

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> ControllerPreconditions:
        """From what `arrays` gave."""
        classifiers = []
        for i in range(int(arrays["count"])):
            mine = {key.partition(".")[2]: value for key, value in arrays.items() if key.startswith(f"{i}.")}
            classifiers.append(PreconditionClassifier.from_arrays(mine))
        return cls(tuple(classifiers), np.asarray(arrays["columns"]), float(arrays["threshold"]))


@dataclass(frozen=True)
class ControllerStarts:
    """K states, each with a controller to start there.

    Attributes:
        rows: [K].
        option: [K] the controller.
        source: [K] number of the nominal run, or of the failure, that the state is taken from.
        muted: [K] the flag of a failure is still up.
    """

    rows: Rows
    option: IntArray
    source: IntArray
    muted: BoolArray

    def __len__(self) -> int:
        return len(self.option)

    def take(self, index: IntArray | BoolArray) -> ControllerStarts:
        """Those of `index`."""
        where = np.asarray(index)
        return ControllerStarts(self.rows.take(where), self.option[where], self.source[where], self.muted[where])

    def join(self, other: ControllerStarts) -> ControllerStarts:
        """These, then those of `other`."""
        pairs = ((getattr(self, name), getattr(other, name)) for name in ("option", "source", "muted"))
        return ControllerStarts(Rows.join([self.rows, other.rows]), *(np.concatenate(pair) for pair in pairs))


@dataclass(frozen=True)
class TrajectoryStates:
    """K states with labels.

    Attributes:
        observation: [K].
        option: [K] the controller that was started there.
        success: [K] of the task, done by that controller and those after it.
    """

    observation: Observation
    option: IntArray
    success: BoolArray

    def take(self, index: IntArray | BoolArray) -> TrajectoryStates:
        """Those of `index`."""
        return TrajectoryStates(self.observation.take(index), self.option[index], self.success[index])


@dataclass(frozen=True)
class OfflineFit:
    """Preconditions, and what is to be known of them.

    Attributes:
        preconditions: of the controllers.
        steps: control steps simulated for them.
        held_out_precision: share of the held-out states where one holds from which its controller does the task.
        held_out_support: number of those states.
    """

    preconditions: ControllerPreconditions
    steps: int
    held_out_precision: float
    held_out_support: int


def visit(world: World, nominal: Sequence[Option], starts: Rows, *, every: int) -> tuple[ControllerStarts, int]:
    """States of one nominal run from each of `starts`, the first and every so many control steps; and all its steps."""
    parts: list[Rows] = [starts]
    episodes: list[IntArray] = [np.arange(len(starts))]
    times: list[IntArray] = [np.zeros(len(starts), dtype=np.int64)]

    def watch(episode: IntArray, step: IntArray, rows: Rows) -> None:
        due = step % every == 0
        if due.any():
            parts.append(rows.take(due))
            episodes.append(episode[due])
            times.append(step[due])

    execution = run(world, nominal, starts, watch=watch)
    episode, step = np.concatenate(episodes), np.concatenate(times)
    order = np.lexsort((step, episode))
    rows, episode, step = Rows.join(parts).take(order), episode[order], step[order]
    before = (execution.ends.episode[None] == episode[:, None]) & (execution.ends.step[None] <= step[:, None])
    option = np.minimum(before.sum(axis=1), len(nominal) - 1)
    flagged = (execution.last.step[episode] == step) & ~execution.success[episode]
    keep = ~flagged  # no controller starts at the moment of failure
    visited = ControllerStarts(rows.take(keep), option[keep], episode[keep], np.zeros(int(keep.sum()), dtype=np.bool_))
    return visited, int(execution.last.step.sum())


def at_failures(failures: Rows, controllers: int, first_source: int) -> ControllerStarts:
    """Every controller at each of the failures, whose sources are counted from `first_source`."""
    place = np.repeat(np.arange(len(failures)), controllers)
    option = np.tile(np.arange(controllers), len(failures))
    return ControllerStarts(failures.take(place), option, first_source + place, np.ones(len(place), dtype=np.bool_))


def restart(world: World, nominal: Sequence[Option], starts: ControllerStarts) -> tuple[BoolArray, int]:
    """[K] whether the chain does the task from each state, started at its controller; and the control steps of all."""
    execution = run(world, nominal, starts.rows, first=starts.option, muted=starts.muted)
    return execution.success, int(execution.last.step.sum())


def fit_offline(
    world: World,
    nominal: Sequence[Option],
    starts: ControllerStarts,
    fields: Sequence[str],
    threshold: float,
    precision: float | None,
    held_out: float,
    rng: np.random.Generator,
) -> OfflineFit:
    """Label the states, fit classifiers to most of them and calibrate the threshold on the others.

    Args:
        world: where.
        nominal: the chain.
        starts: states and controllers; those of one source are all held out, or none is.
        fields: of the observation (empty: all).
        threshold: probability from which a precondition holds, at least.
        precision: share of the held-out states where a precondition holds that should succeed. If no more do, the
            threshold is raised to the lowest with which more do; it stays where there is none. None: it stays.
        held_out: share of the sources.
        rng: of the split and the fits.

    Raises:
        ConfigError: a controller never led to success.
    """
    success, steps = restart(world, nominal, starts)
    sources = np.unique(starts.source)
    apart = rng.permutation(sources)[: round(held_out * len(sources))]
    mine = ~np.isin(starts.source, apart)
    states = TrajectoryStates(world.observe(starts.rows), starts.option, success)
    preconditions = fit(states.take(mine), nominal, fields, threshold, rng)
    # A failure stands there once for each controller; handing over, the best one alone is started.
    others = starts.take(~mine & ~(starts.muted & (starts.option > 0)))
    seen = _chosen(world.observe(others.rows), fields).values
    handover = replace(others, option=preconditions.best(seen))
    well, more = restart(world, nominal, handover)
    score = preconditions.score(seen).max(axis=1)
    above = score >= threshold
    if precision is not None and above.any() and well[above].mean() <= precision:
        calibrated = certain_from(score[above], well[above], precision, SUPPORT)
        preconditions = replace(preconditions, threshold=threshold if calibrated is None else calibrated)
    holds = score >= preconditions.threshold
    share = float(well[holds].mean()) if holds.any() else 0.0
    return OfflineFit(preconditions, steps + more, share, int(holds.sum()))


def fit(
    states: TrajectoryStates,
    nominal: Sequence[Option],
    fields: Sequence[str],
    threshold: float,
    rng: np.random.Generator,
) -> ControllerPreconditions:
    """Fit a classifier for each controller over `fields` of the observation (empty: all).

    Raises:
        ConfigError: a controller never led to success.
    """
    observation = _chosen(states.observation, fields)
    names = np.array(observation.names)
    columns = np.flatnonzero(names != COUNTER)
    classifiers = []
    for index, option in enumerate(nominal):
        mine = states.option == index
        if states.success[mine].sum() < 2:
            raise ConfigError(
                f"no nominal trajectory got through '{option.name}' to success; run more of them (trajectories)"
            )
        classifiers.append(
            fit_classifier(observation.values[mine][:, columns], states.success[mine], tuple(names[columns]), rng)
        )
    return ControllerPreconditions(tuple(classifiers), columns, threshold)


def _chosen(observation: Observation, fields: Sequence[str]) -> Observation:
    return Observation.of({name: observation[name] for name in fields}) if fields else observation
