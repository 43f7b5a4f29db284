"""What is known of macros: every outcome so far, and a forest that predicts the success of a macro from a state.

The forest sees the state at the failure, the differences of all positions in it (where the hand is relative to the
thing, to the shelf, to its target), and which macro it is asked for; so what one macro met tells about its neighbours.

Axis letters: N failures, T outcomes, K macros, O state columns, F features, E trees.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from sklearn.ensemble import ExtraTreesClassifier

from p2l.chaining.search.macros import Macro, MacroSpace
from p2l.records import Array, BoolArray, IntArray

TREES = 100
LEAF = 3  # outcomes of a leaf, at least
SHARE_OF_COLUMNS = 0.3  # looked at for a split
POSITION = "_pos_m"


class OutcomeTable:
    """Outcomes by macro and failure; a trial is never repeated, since it would end the same."""

    def __init__(self) -> None:
        self._of: dict[Macro, dict[int, bool]] = {}
        self.failure: list[int] = []
        self.macro: list[Macro] = []
        self.success: list[bool] = []

    def __len__(self) -> int:
        return len(self.failure)

    def add(self, failure: int, macro: Macro, success: bool) -> None:
        """One outcome more."""
        self._of.setdefault(macro, {})[failure] = success
        self.failure.append(failure)
        self.macro.append(macro)
        self.success.append(success)

    def tried(self, failure: int, macro: Macro) -> bool:
        """Whether the outcome is known."""
        return failure in self._of.get(macro, ())

    def succeeded(self, failure: int, macro: Macro) -> bool:
        """The outcome of a trial."""
        return self._of[macro][failure]

    def solved(self, failures: int) -> BoolArray:
        """[failures] whether some macro has recovered from each of the first ones."""
        return np.isin(np.arange(failures), [one for one, well in zip(self.failure, self.success, strict=True) if well])

    def counts(self, macro: Macro) -> tuple[int, int]:
        """On how many failures a macro was tried, and from how many it recovered."""
        outcomes = self._of.get(macro, {})
        return len(outcomes), sum(outcomes.values())

    def rate(self, macro: Macro) -> float:
        """Share of its failures that a macro recovers from, with a prior of 0.15 worth two trials."""
        tried, recovered = self.counts(macro)
        return (recovered + 0.3) / (tried + 2)

    def winners(self, most: int) -> list[Macro]:
        """Macros that have recovered from some failure, the most general first."""
        winners = [macro for macro, outcomes in self._of.items() if any(outcomes.values())]
        return sorted(winners, key=lambda macro: (-self.rate(macro), macro))[:most]


def pair_features(states: Array, columns: Sequence[str]) -> Array:
    """[N, F] the states [N, O], and the differences of all their positions of the same moment."""
    names = [name.partition("[")[0] for name in columns]
    fields = [name for name in dict.fromkeys(names) if POSITION in name]
    parts = [states]
    for one, other in combinations(fields, 2):
        first, second = ([place for place, name in enumerate(names) if name == field] for field in (one, other))
        if one.partition("@")[2] == other.partition("@")[2] and len(first) == len(second):
            parts.append(states[:, first] - states[:, second])
    return np.concatenate(parts, axis=1)


@dataclass(frozen=True)
class SuccessModel:
    """P(success | state at the failure, macro).

    Attributes:
        forest: over features and the macro's encoding.
        space: of the macros.
    """

    forest: ExtraTreesClassifier
    space: MacroSpace

    @classmethod
    def fit(cls, features: Array, table: OutcomeTable, space: MacroSpace, seed: int) -> SuccessModel | None:
        """From every outcome; None where all are alike.

        Args:
            features: [N, F] of the failures.
            table: T outcomes.
            space: of the macros.
            seed: of the trees.
        """
        if len(set(table.success)) < 2:
            return None
        known = list(dict.fromkeys(table.macro))
        place = {macro: row for row, macro in enumerate(known)}
        codes = space.encoding(known)[[place[macro] for macro in table.macro]]
        inputs = np.concatenate([features[table.failure], codes], axis=1)
        forest = ExtraTreesClassifier(
            TREES, min_samples_leaf=LEAF, max_features=SHARE_OF_COLUMNS, random_state=seed & (2**32 - 1)
        )
        return cls(forest.fit(inputs.astype(np.float32), np.array(table.success)), space)

    def probability(self, features: Array, macros: Sequence[Macro], trees: IntArray | None = None) -> Array:
        """[N, K] of [N, F] by all trees, or by some of them: what those believe."""
        each, every = np.repeat(features, len(macros), axis=0), np.tile(self.space.encoding(macros), (len(features), 1))
        return self._votes(each, every, trees).reshape(len(features), len(macros))

    def of_pairs(self, features: Array, macros: Sequence[Macro], trees: IntArray | None = None) -> Array:
        """[N] of [N, F], each with its own macro; see `probability`."""
        return self._votes(features, self.space.encoding(macros), trees)

    def _votes(self, features: Array, codes: Array, trees: IntArray | None) -> Array:
        inputs = np.concatenate([features, codes], axis=1).astype(np.float32)
        every = self.forest.estimators_
        asked = range(len(every)) if trees is None else trees
        return np.mean([every[tree].predict_proba(inputs)[:, 1] for tree in asked], axis=0)
