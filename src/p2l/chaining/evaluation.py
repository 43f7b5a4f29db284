"""Evaluation of policies in one world: whole episodes, transfers, reuse and variants of the world.

Everything goes through the ledger, so that tables can be built where nothing was run. Invalid input is refused before
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

from p2l.chaining.ablation import AblationVariant, episodes_of_variant
from p2l.chaining.ceiling import Ceiling, ceiling_of_seed
from p2l.chaining.elsewhere import Variant, robosuite_variant, transfer_of_seed, variants
from p2l.chaining.episodes import Agents, PolicyLedger, check_policies, episodes_of_seed, load_agents, policy_place
from p2l.chaining.novelty import NominalStates
from p2l.chaining.reuse import nominal_sets, reuse_of_seed
from p2l.chaining.search.macros import Macro, load_macros
from p2l.contracts.world import World
from p2l.seeding import generator
from p2l.worlds.table import make_world


@dataclass(frozen=True)
class Transfers:
    """Table 5.2: policies, unchanged, in worlds other than that of their training.

    Attributes:
        learners: whose policies.
        failures: to induce for each policy and variant; 0: no transfer.
        robosuite_failures: to induce in robosuite's own environment; 0: no transfer there.
        variants: by name, the world's parameters that differ.
    """

    learners: Sequence[str]
    failures: int
    robosuite_failures: int
    variants: Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Reuse:
    """Figure 5.9: policies of `learners`; `nominal_runs` of the nominal skills, which give the nominal states."""

    learners: Sequence[str]
    nominal_runs: int


@dataclass(frozen=True)
class Ablation:
    """Policies of `learner` in `variants` of the world; by name, the world's parameters that differ."""

    learner: str
    variants: Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class Subject:
    """The policies to evaluate, and their world.

    Attributes:
        world: name or target.
        params: of the world.
        folder: of `chain_recoveries`.
        learners: whose policies, in `folder`.
        seeds: of the policies, in `folder`.
        episodes: of each policy.
        seed: of the random draws that all policies share.
    """

    world: str
    params: Mapping[str, Any]
    folder: Path
    learners: Sequence[str]
    seeds: Sequence[int]
    episodes: int
    seed: int


@dataclass(frozen=True)
class ChainResults:
    """Results of an evaluation.

    Attributes:
        world: where.
        agents: by seed and learner.
        episodes: rows of `episodes.episodes_of_seed`, of all seeds, and of `ceiling.ceiling_of_seed`.
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
    """The world, and the agents with the policies trained in it, by seed.

    Raises:
        ArtifactError: a policy is missing, damaged, or of another world.
        ConfigError: the world refuses a parameter.
    """
    check_policies(subject.folder, subject.learners, subject.seeds)
    world = make_world(subject.world, subject.params)
    nominal = world.nominal_options()
    return world, {seed: load_agents(subject.folder, subject.learners, seed, world, nominal) for seed in subject.seeds}


def evaluate(
    book: PolicyLedger,
    subject: Subject,
    world: World,
    agents: Mapping[int, Agents],
    transfers: Transfers,
    reuse: Reuse,
    ablation: Ablation,
    ceiling: Ceiling,
    counter: Callable[[int], Callable[[int], None]],
) -> ChainResults:
    """Results of every item, looked up in the ledger or run and recorded.

    Args:
        book: the ledger.
        subject: the policies and their world.
        world: of `open_policies`.
        agents: of `open_policies`.
        transfers: settings of table 5.2.
        reuse: settings of figure 5.9.
        ablation: settings of section 5.4.2.
        ceiling: macros without a policy.
        counter: makes a progress counter for so many policies, which is called with 1 after each.

    Raises:
        ArtifactError: a policy is missing, damaged, or of another world.
        ConfigError: the world, or a variant, refuses a parameter.
    """
    nominal = world.nominal_options()

    @cache
    def nominal_states() -> NominalStates:
        rng = generator(subject.seed, "evaluate_chains", world.name, "nominal_runs")
        return nominal_sets(world, nominal, world.sample(rng, reuse.nominal_runs))

    transfer_learners = [learner for learner in transfers.learners if learner in subject.learners]
    episode_parts, transfer_parts, reuse_parts = [], [], []
    with ExitStack() as stack:
        ablation_variants, transfer_variants = (
            _ablation_variants(subject, ablation),
            _transfer_variants(subject, world, transfers, stack),
        )
        variant_agents = {
            seed: [
                (one, load_agents(subject.folder, transfer_learners, seed, one.world, one.nominal, transfer=True))
                for one in transfer_variants
            ]
            for seed in subject.seeds
        }
        show = counter(
            len(subject.seeds)
            * (len(subject.learners) + len(transfer_variants) * len(transfer_learners) + len(ablation_variants))
        )
        macros = _macros(subject, agents, ceiling)
        for seed in subject.seeds:
            episode_parts.append(episodes_of_seed(book, world, nominal, seed, agents[seed], subject.episodes, show))
            if seed in macros:
                source = agents[seed][ceiling.learner]
                rest = (source, macros[seed], subject.episodes)
                episode_parts.append(ceiling_of_seed(book, world, nominal, seed, *rest))
            transfer_parts.append(transfer_of_seed(book, variant_agents[seed], seed, show))
            reuse_agents = {name: agents[seed][name] for name in subject.learners if name in reuse.learners}
            key = (subject.seed, reuse.nominal_runs)
            reuse_parts.append(
                reuse_of_seed(book, world, nominal, seed, reuse_agents, subject.episodes, nominal_states, key)
            )
        variant_episodes = {
            one.name: episodes_of_variant(book, one, subject.episodes, show) for one in ablation_variants
        }
    episode_rows, transfer_rows, reuse_rows = (
        pd.concat(parts, ignore_index=True) for parts in (episode_parts, transfer_parts, reuse_parts)
    )
    return ChainResults(world, agents, episode_rows, transfer_rows, reuse_rows, variant_episodes)


def left_out(subject: Subject, transfers: Transfers, reuse: Reuse, results: ChainResults) -> list[str]:
    """What a person would look for in the results and not find, each with its reason."""
    told, elsewhere = [], bool(transfers.failures or transfers.robosuite_failures)
    for place, names, table in (
        ("transfer.learners", transfers.learners if elsewhere else subject.learners, "table_5_2"),
        ("reuse.learners", reuse.learners, "figure_5_9"),
    ):
        if not set(names) & set(subject.learners):
            given = f"{place} names {', '.join(names) or 'nobody'}"
            told.append(f"{table} has no rows, since {given}; evaluated are {', '.join(subject.learners)}")
    if diverged := int(results.episodes["diverged"].sum()):
        told.append(f"the simulation of {diverged} of {len(results.episodes)} episodes broke down; they are left out")
    return told


def _macros(subject: Subject, agents: Mapping[int, Agents], ceiling: Ceiling) -> dict[int, list[Macro]]:
    """Macros of each seed's search, where there is one."""
    if not ceiling.macros or ceiling.learner not in subject.learners:
        return {}
    found = {}
    for seed in subject.seeds:
        actions = agents[seed][ceiling.learner][1].card.actions
        found[seed] = load_macros(policy_place(subject.folder, ceiling.learner, seed), actions, ceiling.macros)
    return found


def _ablation_variants(subject: Subject, ablation: Ablation) -> list[AblationVariant]:
    """Variants of the world; their policies lie beside the configured world's, with the variant's name appended."""
    ablation_variants = []
    for name in ablation.variants:
        check_policies(_of_variant(subject, name), [ablation.learner], subject.seeds)
    for name, differs in ablation.variants.items():
        world = make_world(subject.world, {**subject.params, **differs})
        nominal, folder = world.nominal_options(), _of_variant(subject, name)
        agents = {seed: load_agents(folder, [ablation.learner], seed, world, nominal) for seed in subject.seeds}
        ablation_variants.append(AblationVariant(name, world, nominal, agents))
    return ablation_variants


def _of_variant(subject: Subject, name: str) -> Path:
    return subject.folder.with_name(f"{subject.folder.name}_{name}")


def _transfer_variants(subject: Subject, world: World, transfers: Transfers, stack: ExitStack) -> list[Variant]:
    """The worlds to transfer policies to."""
    transfer_variants = []
    if transfers.failures:
        transfer_variants += variants(subject.world, subject.params, transfers.variants, transfers.failures)
    if transfers.robosuite_failures:
        transfer_variants.append(robosuite_variant(world, transfers.robosuite_failures, stack))
    return transfer_variants
