"""Lazy RecoveryChaining: options whose success is certain enough are rewarded without simulation.

One classifier per nominal option is refitted to the outcomes so far. Where its precision on held-out outcomes
exceeds `precision` at a threshold, an option that scores above the threshold ends the episode with reward 1. The
outcome of an option does not depend on the policy, so every outcome stays valid for the whole run.

1. A repeated outcome, of the same option from the same observation, does not count: episodes start at the same failures
   time and again, and copies on both sides of the split would make any forest look right.
2. A share of the certain options is simulated all the same (`audit`): the policy goes where it is rewarded, and without
   audits a forest that is wrong there would never be corrected.
3. The budget is charged for what is not simulated, too, with the mean length of that option's simulated successes. So a
   run makes as many decisions as RecoveryChaining's, and the control steps that it spares are a result, not a setting.
4. The classifier is a forest of randomised trees: no scale to tune, and probabilities that are shares of votes.

Axis letters: K decisions, O observation columns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.model_selection import train_test_split

from p2l.chaining.certainty import certain_from
from p2l.chaining.learner import ChainTask, Learner, share, whole
from p2l.chaining.mdp import Limits, Transitions
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray
from p2l.seeding import entropy, generator, generator_state, restore_generator


@dataclass(frozen=True)
class LazySettings:
    """When an option counts as certain.

    Attributes:
        outcomes: of an option, needed for its first classifier.
        of_either_kind: successes, and failures, among them.
        refit_after: new outcomes between fits.
        precision: on held-out outcomes above the threshold.
        held_out: share of the outcomes.
        support: held-out outcomes above the threshold, at least.
        audit: share of the certain options that is simulated all the same.
        trees: of the forest.
    """

    outcomes: int = 50
    of_either_kind: int = 20
    refit_after: int = 25
    precision: float = 0.95
    held_out: float = 0.3
    support: int = 10
    audit: float = 0.1
    trees: int = 50

    def __post_init__(self) -> None:
        least = {"outcomes": 1, "of_either_kind": 2, "refit_after": 1, "support": 1, "trees": 1}  # 2: one is held out
        for name, number in least.items():
            if not whole(getattr(self, name), at_least=number):
                value = getattr(self, name)
                raise ConfigError(f"lazy_rc: {name} must be an integer of at least {number}, got {value!r}")
        for name in ("precision", "held_out"):
            if not share(getattr(self, name)):
                raise ConfigError(f"lazy_rc: {name} must be a number above 0 and below 1, got {getattr(self, name)!r}")
        if not share(self.audit) and self.audit != 1.0:  # without audits no forest is ever corrected
            raise ConfigError(f"lazy_rc: audit must be a number above 0 and at most 1, got {self.audit!r}")


class Lazy:
    """Outcomes of the nominal options so far, and classifiers of their success.

    Args:
        own: number of the agent's own actions, which come before the options.
        options: number of nominal options.
        settings: when an option counts as certain.
        seed: of forests, splits and audits.
    """

    def __init__(self, own: int, options: int, settings: LazySettings, seed: int) -> None:
        self.settings, self._own = settings, own
        self._seed = seed
        self._rng = generator(seed, "lazy_rc", "audit")
        self._observations: list[list[Array]] = [[] for _ in range(options)]
        self._keys: list[set[bytes]] = [set() for _ in range(options)]  # the observations as bytes
        self._successes: list[list[bool]] = [[] for _ in range(options)]
        self._fit_sizes = [0] * options
        self._forests: list[tuple[ExtraTreesClassifier, float] | None] = [None] * options
        self._pending: dict[int, tuple[int, Array]] = {}
        self._lengths = np.zeros((options, 2), dtype=np.int64)  # control steps of simulated successes, and their number
        self.spared = 0

    def sure(self, observation: Array, action: IntArray) -> BoolArray:
        """[K] certain to succeed, and not selected for an audit."""
        certain = np.zeros(len(action), dtype=np.bool_)
        for option, classifier in enumerate(self._forests):
            mine = np.flatnonzero(action == self._own + option)
            if classifier is not None and len(mine):
                forest, threshold = classifier
                certain[mine] = forest.predict_proba(observation[mine])[:, 1] >= threshold
        return np.asarray(certain & (self._rng.random(len(action)) >= self.settings.audit))

    def spare(self, action: IntArray) -> None:
        """Count options [K] that are not simulated, each with the mean length of its simulated successes."""
        steps, number = self._lengths[action - self._own].T
        self.spared += int(np.rint(steps / np.maximum(number, 1)).sum())

    def begin(self, slots: IntArray, observation: Array, action: IntArray) -> None:
        """Remember the options that are simulated, and their observations."""
        for slot, one, option in zip(slots.tolist(), observation, (action - self._own).tolist(), strict=True):
            if option >= 0:
                self._pending[slot] = (option, one)

    def end(self, transitions: Transitions) -> None:
        """Learn from the outcomes of options that have ended."""
        outcomes = zip(transitions.slot.tolist(), transitions.done.tolist(), transitions.steps.tolist(), strict=True)
        for slot, done, steps in outcomes:
            if (pending := self._pending.pop(slot, None)) is not None:
                self._note(*pending, done)
                self._lengths[pending[0]] += done * np.array([steps, 1])
        for option, successes in enumerate(self._successes):
            if len(successes) - self._fit_sizes[option] >= self.settings.refit_after:
                self._refit(option)

    def _note(self, option: int, observation: Array, success: bool) -> None:
        if (key := observation.tobytes()) not in self._keys[option]:
            self._keys[option].add(key)
            self._observations[option].append(observation)
            self._successes[option].append(success)

    def _refit(self, option: int) -> None:
        settings, success = self.settings, np.array(self._successes[option])
        if len(success) < settings.outcomes or min(success.sum(), (~success).sum()) < settings.of_either_kind:
            return
        self._fit_sizes[option] = len(success)
        seed = entropy(self._seed, "lazy_rc", option, len(success)) & (2**32 - 1)
        parts = train_test_split(
            np.stack(self._observations[option]),
            success,
            test_size=settings.held_out,
            stratify=success,
            random_state=seed,
        )
        forest = ExtraTreesClassifier(settings.trees, min_samples_leaf=2, random_state=seed).fit(parts[0], parts[2])
        threshold = certain_from(forest.predict_proba(parts[1])[:, 1], parts[3], settings.precision, settings.support)
        self._forests[option] = None if threshold is None else (forest, threshold)

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Everything that decides its future, for a checkpoint; forests are fitted again."""
        pending = (
            {}
            if not self._pending
            else {
                "slots": np.array(list(self._pending)),
                "options": np.array([option for option, _ in self._pending.values()]),
                "observations": np.stack([observation for _, observation in self._pending.values()]),
            }
        )
        arrays: dict[str, npt.NDArray[Any]] = {
            "rng": generator_state(self._rng),
            "fit_sizes": np.array(self._fit_sizes),
            "lengths": self._lengths,
            "spared": np.array(self.spared),
            **pending,
        }
        arrays |= {
            f"seen.{option}": np.stack(observations)
            for option, observations in enumerate(self._observations)
            if observations
        }
        return arrays | {
            f"paid.{option}": np.array(successes, dtype=float)
            for option, successes in enumerate(self._successes)
            if successes
        }

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """From what `state` gave."""
        restore_generator(self._rng, state["rng"])
        self._lengths[:], self.spared = state["lengths"], int(state["spared"])
        for option, fit_size in enumerate(state["fit_sizes"].tolist()):
            if f"seen.{option}" in state:
                outcomes = zip(state[f"seen.{option}"], state[f"paid.{option}"], strict=True)
                for number, (observation, success) in enumerate(outcomes, start=1):
                    self._note(option, observation, bool(success > 0.5))
                    if number == fit_size:
                        self._refit(option)
        if "slots" in state:
            options = zip(state["options"].tolist(), state["observations"], strict=True)
            self._pending = dict(zip(state["slots"].tolist(), options, strict=True))


def learner(
    task: ChainTask,
    limits: Limits,
    *,
    outcomes: int = 50,
    of_either_kind: int = 20,
    precision: float = 0.95,
    audit: float = 0.1,
) -> Learner:
    """RecoveryChaining without simulation of certain options; for the settings see `LazySettings`."""
    settings = LazySettings(outcomes=outcomes, of_either_kind=of_either_kind, precision=precision, audit=audit)
    own = task.world.primitives()
    return Learner(limits, task.failures, own, shortcut=Lazy(len(own), len(task.nominal), settings, task.seed))
