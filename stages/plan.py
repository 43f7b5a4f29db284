"""Stage `plan`: who does which task, and which lessons pay (thesis, section 3.3)."""

from __future__ import annotations

from pathlib import Path

from p2l.artifacts import load_arrays, save_json, save_table
from p2l.schema import PlanConfig
from p2l.tracking import Tracker
from stages._bridge import ledger_of
from stages._stage import stage


@stage("plan", PlanConfig)
def run(cfg: PlanConfig, out: Path, track: Tracker) -> None:
    """Plan a person's own tasks, for an uncertain tomorrow or without one, or the sets of the domain's study."""
    if cfg.tasks is not None and cfg.has_future:
        from stages._tomorrow import plan_both_days

        plan_both_days(cfg, out, track)
    elif cfg.tasks is not None and cfg.transfer is not None:
        from stages._shop import plan_own_tasks

        plan_own_tasks(cfg, out, track)
    else:
        _study_sets(cfg, out, track)


def _study_sets(cfg: PlanConfig, out: Path, track: Tracker) -> None:
    from p2l.domains.table import make_domain
    from p2l.records import TransferData
    from p2l.team.execute import study_plans
    from p2l.team.pretrained import measurement
    from p2l.transfer.model import load_transfer_model

    domain, study = make_domain(cfg.domain.key, cfg.domain.params), cfg.study.study()
    model = load_transfer_model(cfg.transfer_model, feature_names=domain.feature_names, encoding=domain.encoding)
    collected = TransferData.from_arrays(load_arrays(cfg.transfer_data, schema="transfer_data", version=1))
    measure = None if not study.pretrained_draws else measurement(domain, study, cfg.seed, *ledger_of("plan", cfg, out))
    thetas, plans = study_plans(domain, study, cfg.seed, collected, model.predict, cfg.time_limit_s, measure)
    save_table(out / "plans.parquet", plans, schema="plans", version=1)
    facts = {"thetas": thetas, "plans": len(plans), **study.executions}
    save_json(out / "summary.json", facts, schema="plan_summary", version=1)
    track.metrics({f"{name}/best_theta": theta for name, theta in thetas.items()})


if __name__ == "__main__":
    run()
