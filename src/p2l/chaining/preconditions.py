"""Preconditions of the nominal controllers over deployable observations, fitted offline to nominal trajectories.

For the baseline that learns to reach them (thesis, section 5.3.3): each control step of a nominal run is a state in
which the running controller may be started, labelled by the success of the run.

1. The number of actions so far is left out: in nominal runs it is the number of the controller, so that a recovery,
   which has taken more actions, would never meet a precondition.

Axis letters: K rows, O observation columns, F features, I nominal controllers.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.contracts.observation import Observation
from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.world import World
from p2l.errors import ConfigError
from p2l.preconditions.classifier import PreconditionClassifier, fit_classifier
from p2l.records import Array, BoolArray, IntArray
from p2l.skills.chain import run

COUNTER = "actions"


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
class TrajectoryStates:
    """K states on nominal trajectories.

    Attributes:
        observation: [K].
        option: [K] the running controller.
        success: [K] of the whole episode.
    """

    observation: Observation
    option: IntArray
    success: BoolArray


def visit(world: World, nominal: Sequence[Option], starts: Rows, *, every: int) -> TrajectoryStates:
    """States of one nominal trajectory from each of `starts`, the first and every so many control steps."""
    observations: list[Observation] = [world.observe(starts)]
    episodes: list[IntArray] = [np.arange(len(starts))]
    steps: list[IntArray] = [np.zeros(len(starts), dtype=np.int64)]

    def watch(episode: IntArray, step: IntArray, rows: Rows) -> None:
        due = step % every == 0
        if due.any():
            observations.append(world.observe(rows.take(due)))
            episodes.append(episode[due])
            steps.append(step[due])

    execution = run(world, nominal, starts, watch=watch)
    episode, step = np.concatenate(episodes), np.concatenate(steps)
    order = np.lexsort((step, episode))
    values = np.concatenate([part.values for part in observations])[order]
    episode, step = episode[order], step[order]
    before = (execution.ends.episode[None] == episode[:, None]) & (execution.ends.step[None] <= step[:, None])
    option = np.minimum(before.sum(axis=1), len(nominal) - 1)
    flagged = (execution.last.step[episode] == step) & ~execution.success[episode]
    keep = ~flagged  # no controller starts at the moment of failure
    observation = Observation(observations[0].columns, values[keep])
    return TrajectoryStates(observation, option[keep], execution.success[episode[keep]])


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
    observation = states.observation
    if fields:
        observation = Observation.of({name: observation[name] for name in fields})
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
