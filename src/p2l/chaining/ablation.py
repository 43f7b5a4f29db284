"""Policies trained and evaluated in variants of a world (thesis, section 5.4.2)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import pandas as pd

from p2l.chaining.episodes import Agents, PolicyLedger, episodes_of_seed
from p2l.contracts.option import Option
from p2l.contracts.world import World


@dataclass(frozen=True)
class AblationVariant:
    """A variant of the world with the policies that were trained in it.

    Attributes:
        name: of the variant.
        world: with scaled noise, or with fewer observations.
        nominal: its chain.
        agents: by seed, then by learner.
    """

    name: str
    world: World
    nominal: Sequence[Option]
    agents: Mapping[int, Agents]


def episodes_of_variant(
    book: PolicyLedger, variant: AblationVariant, episodes: int, progress: Callable[[int], None] | None = None
) -> pd.DataFrame:
    """Episodes of all seeds, from the ledger or run and recorded; with the start states of the configured world."""
    place = replace(book, item=f"{book.item}_{variant.name}")
    parts = [
        episodes_of_seed(place, variant.world, variant.nominal, seed, agents, episodes, progress)
        for seed, agents in variant.agents.items()
    ]
    return pd.concat(parts, ignore_index=True)
