"""What a search remembers, and what its network learns from.

Axis letters: N failures, K decisions, O state columns, F features.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from p2l.artifacts import save_json
from p2l.chaining.search.macros import MACROS, Macro, macro_of, padded
from p2l.chaining.search.model import OutcomeTable, SuccessModel
from p2l.chaining.search.proposals import Trial
from p2l.chaining.search.trials import MacroTrials
from p2l.records import Array, IntArray
from p2l.seeding import generator_state, restore_generator

NEAR = 0.1  # of the best probability, for a macro that is learnt from in its place
LOST = 0.3  # how much decisions count that were thought to be the best, and failed


@dataclass
class SearchMemory:
    """All that a search remembers.

    Attributes:
        table: outcomes.
        ways: [K, O] states of each trial, by failure and macro.
        rng: draws the trials.
    """

    table: OutcomeTable
    ways: dict[Trial, Array]
    rng: np.random.Generator

    def add(self, proposed: list[Trial], trials: MacroTrials) -> None:
        """The outcomes of a round."""
        for row, (failure, macro) in enumerate(proposed):
            well = bool(trials.success[row])
            self.table.add(failure, macro, well)
            count = int((trials.actions[row] >= 0).sum())
            self.ways[failure, macro] = trials.states[row, :count].astype(np.float32)

    def tensors(self, width: int) -> dict[str, torch.Tensor]:
        """For a checkpoint; macros are at most `width` long."""
        table, ways = self.table, list(self.ways.values())
        arrays: dict[str, Any] = {
            "failure": np.array(table.failure, dtype=np.int64),
            "macro": padded(table.macro, width),
            "success": np.array(table.success, dtype=np.int64),
            "lengths": np.array([len(way) for way in ways], dtype=np.int64),
            "rng": generator_state(self.rng),
        }
        if ways:
            arrays["states"] = np.concatenate(ways)
        return {name: torch.tensor(np.ascontiguousarray(value)) for name, value in arrays.items()}

    def restore(self, by_name: Mapping[str, torch.Tensor]) -> None:
        """From what `tensors` gave."""
        arrays = {name: value.numpy() for name, value in by_name.items()}
        restore_generator(self.rng, arrays["rng"])
        macros = [macro_of(row) for row in arrays["macro"]]
        outcomes = list(zip(arrays["failure"].tolist(), macros, arrays["success"].tolist(), strict=True))
        for failure, macro, well in outcomes:
            self.table.add(failure, macro, bool(well))
        if outcomes:
            ways = np.split(arrays["states"], np.cumsum(arrays["lengths"])[:-1])
            self.ways = {(failure, macro): way for (failure, macro, _), way in zip(outcomes, ways, strict=True)}

    def examples(
        self, model: SuccessModel | None, features: Array, starts: Array, portfolio: int, ground: IntArray
    ) -> tuple[Array, IntArray, Array]:
        """States [K, O], decisions [K] and how much each counts [K], of all N failures.

        Of each failure those of one macro alone, since decisions of several mixed are those of none: of the ones that
        were carried out there, the one that the model believes in most if it recovered, or is the best of all; where
        that is far from the best, the first decision of the best.

        Args:
            model: of all outcomes.
            features: [N, F] of the failures.
            starts: [N, O] their states.
            portfolio: macros that are chosen among.
            ground: [N] the world of each failure.
        """
        macros = self.chosen_among(portfolio)
        place = {macro: column for column, macro in enumerate(macros)}
        rates = np.array([self.table.rate(macro) for macro in macros])
        beliefs = np.tile(rates, (len(features), 1)) if model is None else model.probability(features, macros)
        for world in np.unique(ground):  # what is best everywhere in a world, unless another is clearly better
            mine = np.flatnonzero(ground == world)
            beliefs[mine, beliefs[mine].mean(axis=0).argmax()] += NEAR
        best = beliefs.argmax(axis=1)
        carried_out: dict[int, list[tuple[float, Macro]]] = {}
        for failure, macro in self.ways:
            if macro in place and (self.table.succeeded(failure, macro) or place[macro] == best[failure]):
                carried_out.setdefault(failure, []).append((beliefs[failure, place[macro]], macro))
        states, taken, counts = [], [], []
        for failure, column in enumerate(best.tolist()):
            belief, macro = max(carried_out.get(failure, []), default=(-1.0, macros[column]))
            near = belief > beliefs[failure, column] - NEAR
            way = self.ways[failure, macro] if near else starts[[failure]]
            states.append(way)
            taken.append(np.array((macro if near else macros[column])[: len(way)]))
            counts.append(np.full(len(way), LOST if near and not self.table.succeeded(failure, macro) else 1.0))
        return np.concatenate(states), np.concatenate(taken), np.concatenate(counts)

    def chosen_among(self, portfolio: int) -> list[Macro]:
        """The macros that recovered from most failures; the first one that was tried, where none recovered from any."""
        return self.table.winners(portfolio) or self.table.macro[:1]

    def save_macros(self, folder: Path, actions: Sequence[str], portfolio: int) -> None:
        """Write `macros.json`: the macros that are chosen among, the one that recovers from most failures first.

        Args:
            folder: of the run.
            actions: names of all of the policy's.
            portfolio: how many.
        """
        table, macros = self.table, self.chosen_among(portfolio)
        counts = [table.counts(macro) for macro in macros]
        content = {
            "macros": [";".join(actions[action] for action in macro) for macro in macros],
            "tried": [tried for tried, _ in counts],
            "recovered": [recovered for _, recovered in counts],
        }
        save_json(folder / MACROS, content, schema="macros", version=1)
