"""Distance of a state from the states in which nominal execution has its options (figure 5.9).

A state is outside a set of nominal states if its nearest neighbour in half of the runs is farther away than that of
99 % of the states of the other half; so about 1 % of nominal states are outside.

Axis letters: K states, F features.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from p2l.records import Array, IntArray

SETS = ("visited", "begun")  # states in which an option is at work, and those in which it starts
QUANTILE = 0.99
FEWEST = 4  # nominal runs through an option for a set of its states


@dataclass(frozen=True)
class StateSet:
    """A set of nominal states.

    Attributes:
        tree: of standardised features.
        limit: distance beyond which a state is outside.
    """

    tree: cKDTree
    limit: float

    @classmethod
    def of(cls, values: Array, episode: IntArray) -> StateSet | None:
        """From standardised [K, F] of the runs `episode` [K]; None if the runs are fewer than `FEWEST`."""
        runs = np.unique(episode)
        if len(runs) < FEWEST:
            return None
        half = np.isin(episode, runs[::2])
        tree = cKDTree(values[half])
        away, _ = tree.query(values[~half])
        return cls(tree, max(float(np.quantile(away, QUANTILE, method="higher")), 1e-9))

    def off(self, values: Array) -> Array:
        """[K] distances of standardised [K, F] in units of the limit: outside above 1."""
        away, _ = self.tree.query(values)
        return np.asarray(away / self.limit)


@dataclass(frozen=True)
class NominalStates:
    """The states in which nominal execution has its options.

    Attributes:
        centre, spread: [F] of the features.
        sets: by option (its number in the chain) and name of `SETS`; None where too few runs got there.
    """

    centre: Array
    spread: Array
    sets: Mapping[tuple[int, str], StateSet | None]

    def off(self, option: int, name: str, values: Array) -> Array:
        """[K] distance of features [K, F] from the nominal states, outside above 1; NaN where those are too few."""
        states = self.sets.get((option, name))
        return np.full(len(values), np.nan) if states is None else states.off((values - self.centre) / self.spread)
