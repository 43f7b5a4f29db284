"""Stage `chain_recoveries`: learn a recovery policy from recorded failures (thesis, chapter 5)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from p2l.artifacts import atomic, save_json
from p2l.chaining.checkpoint import SUMMARY, drop_checkpoint, finished
from p2l.chaining.learner import Learner, Task
from p2l.chaining.learners.table import make_learner
from p2l.chaining.mdp import Limits
from p2l.chaining.ppo import PPOSettings
from p2l.chaining.record import Learnt, copy_policy, find_run, keep_run, learnt_of, run_item
from p2l.chaining.train import Split, TrainSettings, apart_of, card_of, split, train
from p2l.errors import ArtifactError
from p2l.failures.record import Failures, check_params, load_failures, open_world
from p2l.ledger import RECOVERING, Item, code_digest
from p2l.registry import get_world
from p2l.schema import ChainRecoveriesConfig
from p2l.tracking import Tracker
from stages._child import child
from stages._progress import training
from stages._stage import stage


def already(cfg: ChainRecoveriesConfig, out: Path) -> str | None:
    """What to tell where a single run of this configuration has finished in `out`.

    Raises:
        ArtifactError: one of another configuration has.
    """
    if cfg.compare or not finished(out, cfg.alone().hash):
        return None
    return f"{out}: this run has finished already; delete the folder, or choose another, to learn anew"


@stage("chain_recoveries", ChainRecoveriesConfig, already)
def run(cfg: ChainRecoveriesConfig, out: Path, track: Tracker) -> None:
    """Leave policy.safetensors with its card, rounds.csv, evaluations.csv and summary.json.

    Policies of runs that are compared lie in policies/<learner>/s<seed>; their rows tell learner and seed.
    """
    if not cfg.failures.exists():
        raise ArtifactError(
            f"{cfg.failures}: no failures of '{cfg.item}' have been recorded. To discover some: `dvc repro "
            f"discover@{cfg.item}`, or `python -m stages.discover world={cfg.world.name} "
            f"hydra.run.dir={cfg.failures.parent}`"
        )
    failures = load_failures(cfg.failures, "train")
    check_params(failures, cfg.world.name, cfg.world.params, cfg.failures)
    _same_estimator(cfg, failures)
    if cfg.compare:
        _compare(cfg, failures, out, track)
        return
    one = cfg.alone()
    learnt = _learn(one, _prepare(one, failures), out, track)
    whose = {"learner": cfg.learner.name, "seed": cfg.seed}
    _tables(out, {name: getattr(learnt, name).assign(**whose) for name in ("rounds", "evaluations")}, track)
    save_json(out / SUMMARY, learnt.facts, schema="chain_summary", version=1)
    track.metrics(_told(learnt.facts))
    drop_checkpoint(out)
    print(f"{out}: the best policy succeeds in {learnt.facts['best_evaluation']:.0%} of its evaluation's episodes")


def _same_estimator(cfg: ChainRecoveriesConfig, failures: Failures) -> None:
    """Refuse to learn for another estimator than the one that the failures were found under."""
    if cfg.world.params.get("estimator") == failures.origin.params.get("estimator"):
        return
    given, own = (  # a default may be what the other names
        get_world(cfg.world.name, params).estimator.mode for params in (cfg.world.params, failures.origin.params)
    )
    if given != own:
        raise ArtifactError(
            f"{cfg.failures}: found under estimator={own}, the configuration says {given}; say "
            f"world.params.estimator={own} here and in evaluate_chains, or run `python -m stages.discover "
            f"world={cfg.world.name} estimator={given}`"
        )


def _compare(cfg: ChainRecoveriesConfig, failures: Failures, out: Path, track: Tracker) -> None:
    """Every learner with every seed, seed by seed, so that an interruption leaves whole comparisons."""
    records = cfg.records or out / "records"
    # Committed records outlive harmless edits (`record.VERSION` marks the others); a run's own do not.
    code = "" if cfg.records else code_digest(*RECOVERING)
    found: dict[tuple[str, int], Learnt] = {}
    missing: dict[tuple[str, int], Item] = {}
    runs = [(name, seed) for seed in cfg.seeds for name in cfg.compare]
    for name, seed in runs:
        one = cfg.alone(name, seed)
        item = run_item(cfg.item, name, seed, one.hash, failures, code)
        if (known := find_run(records, item, one.hash, _policies(out, name, seed))) is None:
            missing[name, seed] = item
        else:
            _note(track, name, seed, known)
            found[name, seed] = known
    # What one of the learners refuses is refused before any of them learns; between its runs only the seed differs.
    firsts = dict(reversed(missing))
    prepared = {(name, seed): _prepare(cfg.alone(name, seed), failures) for name, seed in firsts.items()}
    for (name, seed), item in missing.items():
        one, place = cfg.alone(name, seed), out / "runs" / f"s{seed}" / name
        if (meanwhile := find_run(records, item, one.hash, _policies(out, name, seed))) is not None:
            found[name, seed] = meanwhile  # another machine's, or another clone's, beside this one
            continue
        ready = prepared.pop((name, seed), None) or _prepare(one, failures)
        with child(track, cfg, "chain_recoveries", name, seed, place) as told:
            found[name, seed] = _learn(one, ready, place / item.config_hash, told)
        keep_run(records, item, found[name, seed], place / item.config_hash)
        copy_policy(place / item.config_hash, _policies(out, name, seed))
        drop_checkpoint(place / item.config_hash)
        _note(track, name, seed, found[name, seed])
    found = {run: found[run] for run in runs}
    tables = {
        kind: pd.concat([getattr(one, kind).assign(learner=name, seed=seed) for (name, seed), one in found.items()])
        for kind in ("rounds", "evaluations")
    }
    _tables(out, tables, track)
    facts = {f"{name}/s{seed}": dict(learnt.facts) for (name, seed), learnt in found.items()}
    save_json(out / SUMMARY, {"runs": facts}, schema="chain_runs", version=1)


def _note(track: Tracker, learner: str, seed: int, learnt: Learnt) -> None:
    track.metrics({f"{learner}/s{seed}/{key}": value for key, value in _told(learnt.facts).items()})


def _policies(out: Path, learner: str, seed: int) -> Path:
    return out / "policies" / learner / f"s{seed}"


@dataclass(frozen=True)
class _Prepared:
    """A run that nothing refuses."""

    settings: TrainSettings
    failures: int
    parts: Split
    task: Task
    learner: Learner


def _prepare(cfg: ChainRecoveriesConfig, failures: Failures) -> _Prepared:
    """All that can be refused about a run."""
    budget = round(cfg.budget * cfg.learner.budget_share)
    ppo = PPOSettings(**cfg.ppo.model_dump())
    settings = TrainSettings(budget, cfg.slots, cfg.evaluation.every, cfg.evaluation.episodes, ppo, cfg.revisit)
    world, nominal = open_world(failures, cfg.failures, cfg.world.params.get("nthread"))
    parts = split(failures.rows, settings.episodes, cfg.seed, world.name)
    task = Task(world, nominal, parts.learnt, cfg.seed)
    learner = make_learner(cfg.learner.name, task, Limits(**cfg.limits.model_dump()), cfg.learner.params)
    return _Prepared(settings, len(failures), parts, task, learner)


def _learn(cfg: ChainRecoveriesConfig, ready: _Prepared, out: Path, track: Tracker) -> Learnt:
    """One run; its policy, and as long as it is under way its checkpoint, are in `out`."""
    settings, parts, task, learner = ready.settings, ready.parts, ready.task, ready.learner
    card = card_of(task, learner, cfg.learner.name, cfg.hash, cfg.narrowest)
    with training(f"{cfg.item} {cfg.learner.name} s{cfg.seed}", settings.budget) as show:

        def report(kind: str, row: Mapping[str, float]) -> None:
            if kind == "resumed":
                show(int(row["control_steps"]), None)
                return
            told = {name.replace("+", "plus "): value for name, value in row.items() if name != "control_steps"}
            track.metrics({f"{kind}/{name}": value for name, value in told.items()}, step=int(row["control_steps"]))
            if kind == "round":
                show(int(row["control_steps"]), row["done"] / max(row["ended"], 1))

        if parts.shared and not learner.whole_task:
            track.note(
                f"{ready.failures} failures are too few to set {settings.episodes} apart: evaluations start at all of "
                "them."
            )
        apart = apart_of(task, learner, parts, settings.episodes)
        progress = train(task, learner, apart, settings, card, out, report)
    return learnt_of(progress, ready.failures, parts.set_apart)


def _tables(out: Path, tables: Mapping[str, pd.DataFrame], track: Tracker) -> None:
    for name, table in tables.items():
        with atomic(out / f"{name}.csv") as temporary:
            table.to_csv(temporary, index=False, float_format="%.6g")
        track.artifact(out / f"{name}.csv")


def _told(facts: Mapping[str, Any]) -> dict[str, float]:
    return {name: value for name, value in facts.items() if value is not None}


if __name__ == "__main__":
    run()
