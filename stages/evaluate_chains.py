"""Stage `evaluate_chains`: nominal where it works, recovery where the detector fires (thesis, equation 5.1)."""

from __future__ import annotations

from contextlib import ExitStack
from functools import cache
from pathlib import Path

import pandas as pd

from p2l.artifacts import save_table
from p2l.chaining.elsewhere import Variant, robosuite_variant, transfer_of_seed, variants
from p2l.chaining.episodes import Book, episodes_of_seed, load_agents
from p2l.chaining.reuse import Nominal, nominal_sets, reuse_of_seed
from p2l.contracts.world import World
from p2l.evaluation.chaining.ablation import Ablated, episodes_of_variant
from p2l.evaluation.chaining.judged import Evaluated, chain_report, read_runs
from p2l.evaluation.video.failures import skip
from p2l.evaluation.video.player import VideoOptions
from p2l.evaluation.video.reuse import film_reuse
from p2l.ledger import RECOVERING, code_digest
from p2l.registry import get_options, get_world
from p2l.schema import EvaluateChainsConfig
from p2l.seeding import generator
from p2l.tracking import Tracker
from stages._progress import counter
from stages._stage import stage


@stage("evaluate_chains", EvaluateChainsConfig)
def run(cfg: EvaluateChainsConfig, out: Path, track: Tracker) -> None:
    """Run or look up every item; leave episodes.parquet, tables and figures of chapter 5, and a summary."""
    world = get_world(cfg.world.name, cfg.world.params)
    nominal = get_options(world.name, world)
    agents = {seed: load_agents(cfg.learnt, cfg.learners, seed, world, nominal) for seed in cfg.seeds}
    runs = read_runs(cfg.learnt, cfg.learners, cfg.seeds)
    # Committed records outlive harmless edits (the modules' VERSION marks the others); a run's own do not.
    code = "" if cfg.records else code_digest(*RECOVERING)
    book = Book(cfg.records or out / "records", code, cfg.item, cfg.slots)

    @cache
    def known() -> Nominal:
        rng = generator(cfg.seed, "evaluate_chains", world.name, "nominal_runs")
        return nominal_sets(world, nominal, world.sample(rng, cfg.reuse.nominal_runs))

    key = (cfg.seed, cfg.reuse.nominal_runs)
    movers = [learner for learner in cfg.transfer.learners if learner in cfg.learners]
    episodes, transfers, reuse = [], [], []
    with ExitStack() as stack:
        ablated, elsewhere = _ablated(cfg), _elsewhere(cfg, world, stack)
        moved = {  # what is refused there is refused before anything is run
            seed: [
                (one, load_agents(cfg.learnt, movers, seed, one.world, one.nominal, transfer=True)) for one in elsewhere
            ]
            for seed in cfg.seeds
        }
        total = len(cfg.seeds) * (len(cfg.learners) + len(elsewhere) * len(movers) + len(ablated))
        show = stack.enter_context(counter(f"evaluate {cfg.item}", " policies", total))
        for seed in cfg.seeds:
            episodes.append(episodes_of_seed(book, world, nominal, seed, agents[seed], cfg.episodes, show))
            transfers.append(transfer_of_seed(book, moved[seed], seed, show))
            again = {name: agents[seed][name] for name in cfg.learners if name in cfg.reuse.learners}
            reuse.append(reuse_of_seed(book, world, nominal, seed, again, cfg.episodes, known, key))
        ablation = {one.name: episodes_of_variant(book, one, cfg.episodes, show) for one in ablated}
    table, moves, starts = (pd.concat(one, ignore_index=True) for one in (episodes, transfers, reuse))
    save_table(out / "episodes.parquet", table, schema="chain_episodes", version=1)
    found = Evaluated(cfg.item, table, runs, moves, starts, ablation)
    numbers, files = chain_report(out, found, cfg.thesis)
    track.metrics(numbers)
    if cfg.videos:
        video = VideoOptions(**cfg.video.model_dump())
        files = [*files, *film_reuse(out / "videos", world, nominal, agents, table, starts, video)]
    else:
        skip(out / "videos", "videos=false")
    for path in files:
        track.artifact(path)
    if broken := int(table["diverged"].sum()):
        track.note(f"The simulation of {broken} of {len(table)} episodes broke down; they are left out.")


def _ablated(cfg: EvaluateChainsConfig) -> list[Ablated]:
    """The world's variants; their policies lie beside the configured world's, with the variant's name appended."""
    found = []
    for name, differs in cfg.ablation.variants.items():
        world = get_world(cfg.world.name, {**cfg.world.params, **differs})
        nominal, learnt = get_options(world.name, world), cfg.learnt.with_name(f"{cfg.learnt.name}_{name}")
        agents = {seed: load_agents(learnt, [cfg.ablation.learner], seed, world, nominal) for seed in cfg.seeds}
        found.append(Ablated(name, world, nominal, agents))
    return found


def _elsewhere(cfg: EvaluateChainsConfig, world: World, stack: ExitStack) -> list[Variant]:
    """Where policies go that were not learnt there."""
    found = []
    if cfg.transfer.failures:
        found += variants(world.name, cfg.world.params, cfg.transfer.variants, cfg.transfer.failures)
    if cfg.transfer.robosuite_failures:
        found.append(robosuite_variant(world, cfg.transfer.robosuite_failures, stack))
    return found


if __name__ == "__main__":
    run()
