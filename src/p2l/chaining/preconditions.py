"""Preconditions of the nominal controllers as a deployed robot sees them, learnt offline from nominal trajectories.

For the baseline that learns to reach them (thesis, section 5.3.3): each control step of a nominal run is a state in
which the controller that is running may be started, labelled by whether the task was done in the end.

1. The number of actions so far is left out: in nominal runs it is the number of the controller, so that a recovery,
   which has taken more actions, would never be where any controller starts.

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
        threshold: probability from which a precondition counts as met.
    """

    classifiers: tuple[PreconditionClassifier, ...]
    columns: IntArray
    threshold: float

    def score(self, observation: Array) -> Array:
        """[K, I] probabilities from [K, O] observations."""
        return np.stack([one.probability(observation[:, self.columns]) for one in self.classifiers], axis=1)

    def met(self, observation: Array) -> BoolArray:
        """[K] whether one of them holds."""
        return np.asarray(self.score(observation).max(axis=1) >= self.threshold)

    def best(self, observation: Array) -> IntArray:
        """[K] the controller that is likeliest to succeed."""
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
        made = []
        for i in range(int(arrays["count"])):
            mine = {key.partition(".")[2]: value for key, value in arrays.items() if key.startswith(f"{i}.")}
            made.append(PreconditionClassifier.from_arrays(mine))
        return cls(tuple(made), np.asarray(arrays["columns"]), float(arrays["threshold"]))


@dataclass(frozen=True)
class Visited:
    """K states on nominal trajectories.

    Attributes:
        seen: [K] observations.
        option: [K] controller that was running.
        success: [K] whether its episode ended well.
    """

    seen: Observation
    option: IntArray
    success: BoolArray


def visit(world: World, nominal: Sequence[Option], starts: Rows, *, every: int) -> Visited:
    """States of one nominal trajectory from each of `starts`, the first and every so many control steps."""
    seen: list[Observation] = [world.observe(starts)]
    episodes: list[IntArray] = [np.arange(len(starts))]
    steps: list[IntArray] = [np.zeros(len(starts), dtype=np.int64)]

    def watch(episode: IntArray, step: IntArray, rows: Rows) -> None:
        due = step % every == 0
        if due.any():
            seen.append(world.observe(rows.take(due)))
            episodes.append(episode[due])
            steps.append(step[due])

    done = run(world, nominal, starts, watch=watch)
    episode, step = np.concatenate(episodes), np.concatenate(steps)
    order = np.lexsort((step, episode))
    values = np.concatenate([part.values for part in seen])[order]
    episode, step = episode[order], step[order]
    before = (done.ends.episode[None] == episode[:, None]) & (done.ends.step[None] <= step[:, None])
    option = np.minimum(before.sum(axis=1), len(nominal) - 1)
    flagged = (done.last.step[episode] == step) & ~done.success[episode]
    kept = ~flagged  # the moment of failure is no moment at which a controller was started
    observed = Observation(seen[0].columns, values[kept])
    return Visited(observed, option[kept], done.success[episode[kept]])


def fit(
    visited: Visited, nominal: Sequence[Option], fields: Sequence[str], threshold: float, rng: np.random.Generator
) -> ControllerPreconditions:
    """A classifier for each controller, over `fields` of the observation (all without any).

    Raises:
        ConfigError: a controller never led to success.
    """
    seen = visited.seen
    if fields:
        seen = Observation.of({name: seen[name] for name in fields})
    names = np.array(seen.names)
    columns = np.flatnonzero(names != COUNTER)
    made = []
    for index, option in enumerate(nominal):
        mine = visited.option == index
        if visited.success[mine].sum() < 2:
            raise ConfigError(
                f"no nominal trajectory got through '{option.name}' to success; run more of them (trajectories)"
            )
        made.append(fit_classifier(seen.values[mine][:, columns], visited.success[mine], tuple(names[columns]), rng))
    return ControllerPreconditions(tuple(made), columns, threshold)
