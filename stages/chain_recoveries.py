"""Stage `chain_recoveries`: learn a recovery policy from recorded failures (thesis, chapter 5)."""

from __future__ import annotations

from pathlib import Path

from p2l.artifacts import save_json
from p2l.chaining.checkpoint import SUMMARY, drop_checkpoint
from p2l.chaining.comparison import compare, curves, learn, prepare
from p2l.chaining.inputs import recorded_failures
from p2l.evaluation.sheets import save_sheets
from p2l.schema import ChainRecoveriesConfig
from p2l.tracking import Tracker
from stages._bridge import code_of, tell_times
from stages._chains import chain_run, closing_line, is_done, run_observer, run_teller
from stages._stage import stage


def already(cfg: ChainRecoveriesConfig, out: Path) -> str | None:
    """What to tell where this single run has finished in `out`; raises where others would be overwritten."""
    if not is_done(cfg, out):
        return None
    return f"{out}: this run has finished already; delete the folder, or choose another, to learn anew"


@stage("chain_recoveries", ChainRecoveriesConfig, already)
def run(cfg: ChainRecoveriesConfig, out: Path, track: Tracker) -> None:
    """Leave policy.safetensors with its card, rounds.csv, evaluations.csv and summary.json.

    Policies of runs that are compared lie in policies/<learner>/s<seed>; their rows tell learner and seed.
    """
    failures = recorded_failures(cfg.failures, cfg.item, cfg.world.key, cfg.world.params)
    if cfg.compare:
        runs = [chain_run(cfg, name, seed) for seed in cfg.seeds for name in cfg.compare]
        place, code = cfg.records or out / "records", code_of("chain_recoveries", cfg, cfg.records)
        watch, finish = run_observer(cfg, track), run_teller(track)
        results = compare(runs, failures, cfg.failures, out, place, code, watch, finish)
        facts = {f"{name}/s{seed}": dict(learnt.facts) for (name, seed), learnt in results.items()}
        save_json(out / SUMMARY, {"runs": facts}, schema="chain_runs", version=1)
    else:
        one = chain_run(cfg)
        with run_observer(cfg, track, alone=True)(one, out) as observer:
            learnt = learn(prepare(one, failures, cfg.failures), out, observer)
        results = {(one.name, one.seed): learnt}
        save_json(out / SUMMARY, learnt.facts, schema="chain_summary", version=1)
        track.metrics(learnt.facts)
        tell_times(track, out, learnt.times)
        drop_checkpoint(out)
        print(f"{out}: {closing_line(learnt)}")
    save_sheets(out, curves(results), {})
    for name in ("rounds", "evaluations"):
        track.artifact(out / f"{name}.csv")


if __name__ == "__main__":
    run()
