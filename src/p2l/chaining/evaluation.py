"""All that is run to judge policies in one world: whole episodes, transfers, reuse and variants of the world.

Everything goes through the ledger, so that tables can be built where nothing was run. What is refused is refused before
anything is run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pandas as pd

from p2l.chaining.ablation import Ablated, episodes_of_variant
from p2l.chaining.elsewhere import Variant, robosuite_variant, transfer_of_seed, variants
from p2l.chaining.episodes import Agents, PolicyLedger, episodes_of_seed, load_agents
from p2l.chaining.novelty import NominalStates
from p2l.chaining.reuse import nominal_sets, reuse_of_seed
from p2l.contracts.world import World
from p2l.seeding import generator
from p2l.worlds.table import make_world


@dataclass(frozen=True)
class Transfers:
    """Table 5.2: policies, unchanged, in worlds that they were not learnt in.

    Attributes:
        learners: whose policies.
        failures: to induce for each policy and variant; none: left out.
        robosuite_failures: to induce in robosuite's own environment.
        variants: by name, the world's parameters that differ.
    """

    learners: Sequence[str]
    failures: int
    robosuite_failures: int
    variants: Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Reuse:
    """Figure 5.9: `learners`, whose policies; `nominal_runs` of the nominal skills, to know where they are."""

    learners: Sequence[str]
    nominal_runs: int


@dataclass(frozen=True)
class Ablation:
    """Policies of `learner` in `variants` of the world; by name, the world's parameters that differ."""

    learner: str
    variants: Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Subject:
    """Whose policies are judged, and where.

    Attributes:
        world: name or target.
        params: of the world.
        learnt: folder of `chain_recoveries`.
        learners: in it.
        seeds: in it.
        episodes: for each.
        seed: of what all policies share.
    """

    world: str
    params: Mapping[str, Any]
    learnt: Path
    learners: Sequence[str]
    seeds: Sequence[int]
    episodes: int
    seed: int


@dataclass(frozen=True)
class ChainResults:
    """What was run.

    Attributes:
        world: where.
        agents: by seed and learner.
        episodes: rows of `episodes.episodes_of_seed`, of all seeds.
        transfers: rows of `elsewhere.transfer_of_seed`.
        reuse: rows of `reuse.reuse_of_seed`.
        ablation: rows of `episodes`, by variant.
    """

    world: World
    agents: Mapping[int, Agents]
    episodes: pd.DataFrame
    transfers: pd.DataFrame
    reuse: pd.DataFrame
    ablation: Mapping[str, pd.DataFrame]


def open_policies(subject: Subject) -> tuple[World, dict[int, Agents]]:
    """The world, and by seed the policies that were learnt in it.

    Raises:
        ArtifactError: a policy is missing, damaged, or of another world.
        ConfigError: the world refuses a parameter.
    """
    world = make_world(subject.world, subject.params)
    nominal = world.nominal_options()
    return world, {seed: load_agents(subject.learnt, subject.learners, seed, world, nominal) for seed in subject.seeds}


def evaluate(
    book: PolicyLedger,
    subject: Subject,
    world: World,
    agents: Mapping[int, Agents],
    transfers: Transfers,
    reuse: Reuse,
    ablation: Ablation,
    counter: Callable[[int], Callable[[int], None]],
) -> ChainResults:
    """Run or look up every item.

    Args:
        book: the ledger.
        subject: who and where.
        world: of `open_policies`.
        agents: of `open_policies`.
        transfers: see there.
        reuse: see there.
        ablation: see there.
        counter: given how many policies there are to judge, what is told 1 after each.

    Raises:
        ArtifactError: a policy is missing, damaged, or of another world.
        ConfigError: the world, or a variant, refuses a parameter.
    """
    nominal = world.nominal_options()

    @cache
    def nominal_states() -> NominalStates:
        rng = generator(subject.seed, "evaluate_chains", world.name, "nominal_runs")
        return nominal_sets(world, nominal, world.sample(rng, reuse.nominal_runs))

    movers = [learner for learner in transfers.learners if learner in subject.learners]
    episodes, moves, starts = [], [], []
    with ExitStack() as stack:
        ablated, places = _ablated(subject, ablation), _places(subject, world, transfers, stack)
        moved = {
            seed: [
                (one, load_agents(subject.learnt, movers, seed, one.world, one.nominal, transfer=True))
                for one in places
            ]
            for seed in subject.seeds
        }
        show = counter(len(subject.seeds) * (len(subject.learners) + len(places) * len(movers) + len(ablated)))
        for seed in subject.seeds:
            episodes.append(episodes_of_seed(book, world, nominal, seed, agents[seed], subject.episodes, show))
            moves.append(transfer_of_seed(book, moved[seed], seed, show))
            again = {name: agents[seed][name] for name in subject.learners if name in reuse.learners}
            key = (subject.seed, reuse.nominal_runs)
            starts.append(reuse_of_seed(book, world, nominal, seed, again, subject.episodes, nominal_states, key))
        variant_episodes = {one.name: episodes_of_variant(book, one, subject.episodes, show) for one in ablated}
    whole, transferred, reused = (pd.concat(parts, ignore_index=True) for parts in (episodes, moves, starts))
    return ChainResults(world, agents, whole, transferred, reused, variant_episodes)


def _ablated(subject: Subject, ablation: Ablation) -> list[Ablated]:
    """The world's variants; their policies lie beside the configured world's, with the variant's name appended."""
    ablated = []
    for name, differs in ablation.variants.items():
        world = make_world(subject.world, {**subject.params, **differs})
        nominal, learnt = world.nominal_options(), subject.learnt.with_name(f"{subject.learnt.name}_{name}")
        agents = {seed: load_agents(learnt, [ablation.learner], seed, world, nominal) for seed in subject.seeds}
        ablated.append(Ablated(name, world, nominal, agents))
    return ablated


def _places(subject: Subject, world: World, transfers: Transfers, stack: ExitStack) -> list[Variant]:
    """Where policies go that were not learnt there."""
    places = []
    if transfers.failures:
        places += variants(subject.world, subject.params, transfers.variants, transfers.failures)
    if transfers.robosuite_failures:
        places.append(robosuite_variant(world, transfers.robosuite_failures, stack))
    return places
