"""Lazy RecoveryChaining: options whose outcome is certain enough are paid without being simulated.

One classifier per nominal option is refitted from the outcomes seen so far. Where its precision on held-out outcomes
exceeds `precision` at a threshold, an option that scores above the threshold ends the episode with reward 1. The
outcome of an option does not depend on the policy, so every outcome stays valid for the whole run.

1. An outcome that has been seen already, of the same option from the same observation, is not counted again: episodes
   start at the same failures time and again, and copies on both sides of the split would make any forest look right.
2. A share of the certain options is simulated all the same (`audit`): the policy goes where it is paid, and a forest
   that is wrong there would otherwise never hear of it.
3. The classifier is a forest of randomised trees: no scale to tune, and probabilities that are shares of votes.

Axis letters: K decisions, O observation columns.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.model_selection import train_test_split

from p2l.chaining.learner import ChainTask, Learner, share, whole
from p2l.chaining.mdp import Limits, Transitions
from p2l.errors import ConfigError
from p2l.records import Array, BoolArray, IntArray
from p2l.seeding import entropy, generator
from p2l.skills.primitives import PRIMITIVES


@dataclass(frozen=True)
class LazySettings:
    """When an option counts as certain.

    Attributes:
        outcomes: seen before a classifier is fitted.
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
                told = getattr(self, name)
                raise ConfigError(f"lazy_rc: {name} must be an integer of at least {number}, got {told!r}")
        for name in ("precision", "held_out"):
            if not share(getattr(self, name)):
                raise ConfigError(f"lazy_rc: {name} must be a number above 0 and below 1, got {getattr(self, name)!r}")
        if not share(self.audit) and self.audit != 1.0:  # without audits a run may simulate nothing, and never end
            raise ConfigError(f"lazy_rc: audit must be a number above 0 and at most 1, got {self.audit!r}")


class Lazy:
    """Outcomes seen so far, and what they make certain.

    Args:
        options: number of nominal options.
        settings: when an option counts as certain.
        seed: of forests, splits and audits.
    """

    def __init__(self, options: int, settings: LazySettings, seed: int) -> None:
        self.settings = settings
        self._seed = seed
        self._rng = generator(seed, "lazy_rc", "audit")
        self._seen: list[list[Array]] = [[] for _ in range(options)]
        self._known: list[set[bytes]] = [set() for _ in range(options)]  # of them, as bytes
        self._paid: list[list[bool]] = [[] for _ in range(options)]
        self._fitted = [0] * options
        self._forests: list[tuple[ExtraTreesClassifier, float] | None] = [None] * options
        self._pending: dict[int, tuple[int, Array]] = {}

    def sure(self, observation: Array, action: IntArray) -> BoolArray:
        """[K] certain, and not up for an audit."""
        found = np.zeros(len(action), dtype=np.bool_)
        for option, known in enumerate(self._forests):
            mine = np.flatnonzero(action == len(PRIMITIVES) + option)
            if known is not None and len(mine):
                forest, threshold = known
                found[mine] = forest.predict_proba(observation[mine])[:, 1] >= threshold
        return np.asarray(found & (self._rng.random(len(action)) >= self.settings.audit))

    def begin(self, slots: IntArray, observation: Array, action: IntArray) -> None:
        """Remember which options are simulated from where."""
        for slot, seen, chosen in zip(slots.tolist(), observation, (action - len(PRIMITIVES)).tolist(), strict=True):
            if chosen >= 0:
                self._pending[slot] = (chosen, seen)

    def end(self, told: Transitions) -> None:
        """Learn from options that have come out."""
        for slot, done in zip(told.slot.tolist(), told.done.tolist(), strict=True):
            if (known := self._pending.pop(slot, None)) is not None:
                self._note(*known, done)
        for option, paid in enumerate(self._paid):
            if len(paid) - self._fitted[option] >= self.settings.refit_after:
                self._refit(option)

    def _note(self, option: int, seen: Array, done: bool) -> None:
        if (key := seen.tobytes()) not in self._known[option]:
            self._known[option].add(key)
            self._seen[option].append(seen)
            self._paid[option].append(done)

    def _refit(self, option: int) -> None:
        settings, paid = self.settings, np.array(self._paid[option])
        if len(paid) < settings.outcomes or min(paid.sum(), (~paid).sum()) < settings.of_either_kind:
            return
        self._fitted[option] = len(paid)
        seed = entropy(self._seed, "lazy_rc", option, len(paid)) & (2**32 - 1)
        parts = train_test_split(
            np.stack(self._seen[option]), paid, test_size=settings.held_out, stratify=paid, random_state=seed
        )
        forest = ExtraTreesClassifier(settings.trees, min_samples_leaf=2, random_state=seed).fit(parts[0], parts[2])
        threshold = certain_from(forest.predict_proba(parts[1])[:, 1], parts[3], settings.precision, settings.support)
        self._forests[option] = None if threshold is None else (forest, threshold)

    def state(self) -> dict[str, Array]:
        """The outcomes, for a checkpoint."""
        known = {f"seen.{option}": np.stack(seen) for option, seen in enumerate(self._seen) if seen}
        return known | {f"paid.{option}": np.array(paid, dtype=float) for option, paid in enumerate(self._paid) if paid}

    def restore(self, state: Mapping[str, Array]) -> None:
        """From what `state` gave."""
        for option in range(len(self._seen)):
            if f"seen.{option}" in state:
                for seen, paid in zip(state[f"seen.{option}"], state[f"paid.{option}"], strict=True):
                    self._note(option, seen, bool(paid > 0.5))
                self._refit(option)


def certain_from(probability: Array, paid: BoolArray, precision: float, support: int) -> float | None:
    """The lowest threshold at and above which more than `precision` of at least `support` outcomes were paid."""
    order = np.argsort(-probability, kind="stable")
    right = np.cumsum(paid[order]) / np.arange(1, len(order) + 1)
    last_of_value = np.append(np.diff(probability[order]) < 0.0, True)
    good = np.flatnonzero((right > precision) & last_of_value & (np.arange(len(order)) >= support - 1))
    return None if not len(good) else float(probability[order[good[-1]]])


def learner(
    task: ChainTask,
    limits: Limits,
    *,
    outcomes: int = 50,
    of_either_kind: int = 20,
    precision: float = 0.95,
    audit: float = 0.1,
) -> Learner:
    """RecoveryChaining with certain options unsimulated; for the settings see `LazySettings`."""
    settings = LazySettings(outcomes=outcomes, of_either_kind=of_either_kind, precision=precision, audit=audit)
    return Learner(limits, task.failures, shortcut=Lazy(len(task.nominal), settings, task.seed))
