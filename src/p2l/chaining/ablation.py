"""Policies that were learnt, and are judged, in variants of a world (thesis, section 5.4.2)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import pandas as pd

from p2l.chaining.episodes import Agents, PolicyLedger, episodes_of_seed
from p2l.contracts.option import Option
from p2l.contracts.world import World


@dataclass(frozen=True)
class Ablated:
    """A variant of the world with the policies, by seed, that were learnt in it.

    Attributes:
        name: of the variant.
        world: with the noise scaled, or the observations cut.
        nominal: its chain.
        agents: by seed.
    """

    name: str
    world: World
    nominal: Sequence[Option]
    agents: Mapping[int, Agents]


def episodes_of_variant(
    book: PolicyLedger, one: Ablated, episodes: int, progress: Callable[[int], None] | None = None
) -> pd.DataFrame:
    """Its episodes of all seeds, from records or leaving them; from the same start states as the configured world's."""
    place = replace(book, item=f"{book.item}_{one.name}")
    parts = [
        episodes_of_seed(place, one.world, one.nominal, seed, agents, episodes, progress)
        for seed, agents in one.agents.items()
    ]
    return pd.concat(parts, ignore_index=True)
