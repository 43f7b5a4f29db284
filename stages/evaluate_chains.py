"""Stage `evaluate_chains`: nominal where it works, recovery where the detector fires (thesis, equation 5.1)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

import pandas as pd

from p2l.artifacts import save_table
from p2l.evaluation.chain_episodes import Agents, Book, episodes_of_seed
from p2l.evaluation.chain_outcome import Evaluated, chain_report, read_runs
from p2l.evaluation.chain_reuse import Nominal, nominal_sets, reuse_of_seed
from p2l.evaluation.chain_reuse_video import film_reuse
from p2l.evaluation.chain_transfer import Variant, transfer_of_seed
from p2l.evaluation.failure_videos import skip
from p2l.evaluation.videos import VideoOptions
from p2l.ledger import RECOVERING, code_digest
from p2l.recoveries.chaining.agent import load_agent
from p2l.registry import get_options, get_world
from p2l.schema import EvaluateChainsConfig
from p2l.seeding import generator
from p2l.skills.option import Option
from p2l.tracking import Tracker
from p2l.worlds.world import World
from stages._progress import counter
from stages._stage import stage

ROBOSUITE = "robosuite"


@stage("evaluate_chains", EvaluateChainsConfig)
def run(cfg: EvaluateChainsConfig, out: Path, track: Tracker) -> None:
    """Run or look up every item; leave episodes.parquet, tables and figures of chapter 5, and a summary."""
    world = get_world(cfg.world.name, cfg.world.params)
    nominal = get_options(world.name, world)
    agents = {seed: _agents(cfg, seed, cfg.learners, world, nominal) for seed in cfg.seeds}
    runs = read_runs(cfg.learnt, cfg.learners, cfg.seeds)
    # Committed records outlive harmless edits (the modules' VERSION marks the others); a run's own do not.
    code = "" if cfg.records else code_digest(*RECOVERING)
    book = Book(cfg.records or out / "records", code, cfg.item, cfg.slots)
    episodes, transfers, reuse = [], [], []
    known = cache(partial(_nominal_sets, cfg, world, nominal))
    key = (cfg.seed, cfg.reuse.nominal_runs)
    movers = [learner for learner in cfg.transfer.learners if learner in cfg.learners]
    with ExitStack() as stack:
        ablated, variants = _ablated(cfg), _variants(cfg, stack)
        moved = {  # what is refused there is refused before anything is run
            seed: [(one, _agents(cfg, seed, movers, one.world, one.nominal, transfer=True)) for one in variants]
            for seed in cfg.seeds
        }
        total = len(cfg.seeds) * (len(cfg.learners) + len(variants) * len(movers) + len(ablated))
        show = stack.enter_context(counter(f"evaluate {cfg.item}", " policies", total))
        for seed in cfg.seeds:
            episodes.append(episodes_of_seed(book, world, nominal, seed, agents[seed], cfg.episodes, show))
            transfers.append(transfer_of_seed(book, moved[seed], seed, show))
            again = {name: agents[seed][name] for name in cfg.learners if name in cfg.reuse.learners}
            reuse.append(reuse_of_seed(book, world, nominal, seed, again, cfg.episodes, known, key))
        ablation = {one.name: _episodes(cfg, book, one, show) for one in ablated}
    table = pd.concat(episodes, ignore_index=True)
    save_table(out / "episodes.parquet", table, schema="chain_episodes", version=1)
    moves, starts = (pd.concat(one, ignore_index=True) for one in (transfers, reuse))
    found = Evaluated(cfg.item, table, runs, moves, starts, ablation)
    numbers, files = chain_report(out, found, cfg.thesis)
    track.metrics(numbers)
    for path in [*files, *_film(cfg, out / "videos", world, nominal, agents, found)]:
        track.artifact(path)
    if broken := int(table["diverged"].sum()):
        track.note(f"The simulation of {broken} of {len(table)} episodes broke down; they are left out.")


def _film(
    cfg: EvaluateChainsConfig,
    folder: Path,
    world: World,
    nominal: Sequence[Option],
    agents: Mapping[int, Agents],
    found: Evaluated,
) -> list[Path]:
    if not cfg.videos:
        skip(folder, "videos=false")
        return []
    video = VideoOptions(**cfg.video.model_dump())
    return film_reuse(folder, world, nominal, agents, found.episodes, found.reuse, video)


def _nominal_sets(cfg: EvaluateChainsConfig, world: World, nominal: Sequence[Option]) -> Nominal:
    rng = generator(cfg.seed, "evaluate_chains", world.name, "nominal_runs")
    return nominal_sets(world, nominal, world.sample(rng, cfg.reuse.nominal_runs))


@dataclass(frozen=True)
class _Ablated:
    """A variant of the world with the policies, by seed, that were learnt in it."""

    name: str
    world: World
    nominal: Sequence[Option]
    agents: Mapping[int, Agents]


def _ablated(cfg: EvaluateChainsConfig) -> list[_Ablated]:
    found = []
    for name, other in cfg.ablation.variants.items():
        world = get_world(cfg.world.name, {**cfg.world.params, **other})
        nominal, folder = get_options(world.name, world), cfg.learnt.with_name(f"{cfg.learnt.name}_{name}")
        there = cfg.model_copy(update={"learnt": folder})
        agents = {seed: _agents(there, seed, [cfg.ablation.learner], world, nominal) for seed in cfg.seeds}
        found.append(_Ablated(name, world, nominal, agents))
    return found


def _episodes(cfg: EvaluateChainsConfig, book: Book, one: _Ablated, show: Callable[[int], None]) -> pd.DataFrame:
    """Those of a variant; from the same start states as the configured world's, with the noise scaled."""
    place = replace(book, item=f"{cfg.item}_{one.name}")
    parts = [
        episodes_of_seed(place, one.world, one.nominal, seed, agents, cfg.episodes, show)
        for seed, agents in one.agents.items()
    ]
    return pd.concat(parts, ignore_index=True)


def _agents(
    cfg: EvaluateChainsConfig,
    seed: int,
    learners: Sequence[str],
    world: World,
    nominal: Sequence[Option],
    *,
    transfer: bool = False,
) -> Agents:
    """The policies of a seed, let into a world."""
    some = world.sample(generator(cfg.seed, "evaluate_chains", world.name), 1)
    folder = cfg.learnt / "policies"
    return {name: load_agent(folder / name / f"s{seed}", world, nominal, some, transfer=transfer) for name in learners}


def _variants(cfg: EvaluateChainsConfig, stack: ExitStack) -> list[Variant]:
    """Where policies go that were not learnt there; `stack` closes robosuite's environment."""
    found = []
    if cfg.transfer.failures:
        for name, other in cfg.transfer.variants.items():
            world = get_world(cfg.world.name, {**cfg.world.params, **other})
            found.append(Variant(name, world, get_options(world.name, world), cfg.transfer.failures))
    if cfg.transfer.robosuite_failures:
        from p2l.evaluation.robosuite_sim import make

        ours = get_world(cfg.world.name, cfg.world.params)
        world = make(ours)
        stack.callback(world.engine.close)
        found.append(Variant(ROBOSUITE, world, get_options(ours.name, ours), cfg.transfer.robosuite_failures, 1))
    return found


if __name__ == "__main__":
    run()
