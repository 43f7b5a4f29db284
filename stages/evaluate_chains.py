"""Stage `evaluate_chains`: nominal where it works, recovery where the detector fires (thesis, equation 5.1)."""

from __future__ import annotations

from functools import partial
from pathlib import Path

from p2l.artifacts import save_table
from p2l.chaining.ceiling import Ceiling
from p2l.chaining.clips import novel_clips
from p2l.chaining.episodes import PolicyLedger
from p2l.chaining.evaluation import Ablation, ChainResults, Reuse, Subject, Transfers, evaluate, left_out, open_policies
from p2l.chaining.reuse import most_novel
from p2l.evaluation.chaining.evaluation import ChainEvaluation, chain_report, evaluation_line, read_runs
from p2l.evaluation.video.failures import skip
from p2l.evaluation.video.player import VideoOptions
from p2l.evaluation.video.reuse import film_reuse
from p2l.schema import EvaluateChainsConfig
from p2l.tracking import Tracker
from stages._bridge import code_of
from stages._progress import late_counter
from stages._stage import stage


@stage("evaluate_chains", EvaluateChainsConfig)
def run(cfg: EvaluateChainsConfig, out: Path, track: Tracker) -> None:
    """Run or look up every item; leave episodes.parquet, tables and figures of chapter 5, and a summary."""
    code = code_of("evaluate_chains", cfg, cfg.records)
    book = PolicyLedger(cfg.records or out / "records", code, cfg.item, cfg.slots)
    who = Subject(cfg.world.key, cfg.world.params, cfg.learnt, cfg.learners, cfg.seeds, cfg.episodes, cfg.seed)
    world, agents = open_policies(who)
    runs = read_runs(cfg.learnt, cfg.learners, cfg.seeds)
    plans = Transfers(**dict(cfg.transfer)), Reuse(**dict(cfg.reuse)), Ablation(**dict(cfg.ablation))
    limit = Ceiling(**dict(cfg.ceiling))
    with late_counter(f"evaluate {cfg.item}", " policies") as show:
        results = evaluate(book, who, world, agents, *plans, limit, show)
    save_table(out / "episodes.parquet", results.episodes, schema="chain_episodes", version=1)
    evaluation = ChainEvaluation(cfg.item, results.episodes, runs, results.transfers, results.reuse, results.ablation)
    numbers, files = chain_report(out, evaluation, cfg.thesis)
    track.metrics(numbers)
    print(f"evaluate_chains {cfg.item}: {evaluation_line(results.episodes)}")
    for path in [*files, *_films(cfg, out / "videos", results)]:
        track.artifact(path)
    for text in left_out(who, *plans[:2], results):
        track.note(text)
        print(f"evaluate_chains {cfg.item}: {text}")


def _films(cfg: EvaluateChainsConfig, folder: Path, results: ChainResults) -> list[Path]:
    """The film of the most novel reuse of an option, or a note why there is none."""
    if not (cfg.videos and len(results.reuse)):
        skip(folder, "no learner of reuse.learners met a failure" if cfg.videos else "videos=false")
        return []
    world, video = results.world, VideoOptions(**cfg.video.model_dump())
    clips = partial(novel_clips, world, world.nominal_options(), results.agents, results.episodes)
    return film_reuse(folder, world, most_novel(results.reuse), clips, video)


if __name__ == "__main__":
    run()
