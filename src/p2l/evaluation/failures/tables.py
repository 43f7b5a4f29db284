"""Summaries of discovery and clustering, and the table of failure modes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from p2l.evaluation.statistics import wilson_interval
from p2l.failures.discovery import Discovery
from p2l.failures.record import SPLITS, Failures
from p2l.records import IntArray

if TYPE_CHECKING:  # who discovers does not load scikit-learn
    from p2l.failures.clustering import Clustering


def split_summary(discovery: Discovery) -> dict[str, Any]:
    """Counts and rates of one split of discovery; diverged episodes are counted, and left out of all other numbers."""
    execution, failures = discovery.execution, discovery.failures
    sound = ~execution.diverged
    trials, successes = int(sound.sum()), int(execution.success.sum())
    failing = np.zeros(len(execution), dtype=np.bool_)
    failing[failures.episode] = True
    return {
        "executions": len(execution),
        "diverged": int(execution.diverged.sum()),
        "success": rate(successes, trials),
        "failures": len(failures),
        "failing_episodes": int(failing.sum()),
        "unrecorded_failing_episodes": int((sound & ~execution.success & ~failing).sum()),
        "control_steps": int(execution.last.step.sum()),
        "first_kind": first_kind(failures),
        "by_option": by_option(failures),
    }


def first_kind(failures: Failures) -> dict[str, int]:
    """Failing episodes by the kind of their first failure; what follows it in an episode is its consequence."""
    order = np.lexsort((failures.step, failures.episode))
    _, first = np.unique(failures.episode[order], return_index=True)
    return dict(Counter(np.array(failures.kind_names())[order[first]].tolist()).most_common())


def discovery_metrics(summary: Mapping[str, Any]) -> dict[str, float]:
    """Headline numbers of `discover`'s summary, for the tracker."""
    numbers: dict[str, float] = {}
    for split in SPLITS:
        part = summary[split]
        numbers |= {f"{split}/{key}": part[key] for key in ("failures", "failing_episodes", "diverged")}
        if part["success"]["mean"] is not None:
            numbers[f"{split}/success"] = part["success"]["mean"]
        for option, row in part["by_option"].items():
            numbers |= {f"{split}/{option}/{kind}": share for kind, share in row["share"].items()}
    return numbers


def discovery_line(summary: Mapping[str, Any]) -> str:
    """One line on the training split: how often the nominal skills succeed, and what goes wrong how often."""
    part = summary["train"]
    rates = part["success"]
    if rates["mean"] is None:
        return f"none of {part['executions']} episodes could be simulated"
    kinds = ", ".join(f"{count} {kind}" for kind, count in part["first_kind"].items()) or "none"
    silent = part["unrecorded_failing_episodes"]
    return (
        f"nominal success {rates['mean']:.0%} ({rates['low']:.0%} to {rates['high']:.0%}) of {rates['trials']} "
        f"episodes; failures: {kinds}" + (f"; {silent} failed without being noticed" if silent else "")
    )


def discovery_times(summary: Mapping[str, Any], seconds: float) -> dict[str, float]:
    """Wall seconds of `discover`, and episodes and control steps per second, of both splits."""
    totals = {key: sum(summary[split][key] for split in SPLITS) for key in ("executions", "control_steps")}
    rates = {"episodes_per_s": totals["executions"], "control_steps_per_s": totals["control_steps"]}
    return {"seconds": seconds, **{name: total / seconds for name, total in rates.items()}}


def rate(successes: int, trials: int) -> dict[str, float | None]:
    """A success rate with its 95 % Wilson interval; no rate without trials."""
    low, high = wilson_interval(successes, trials)
    mean = successes / trials if trials else None
    return {"mean": mean, "low": float(low), "high": float(high), "trials": trials}


def by_option(failures: Failures) -> dict[str, dict[str, Any]]:
    """For every option of the chain: its failures, and the share of each kind among them."""
    pairs = Counter(zip(failures.option_names(), failures.kind_names(), strict=True))
    table = {}
    for option in failures.origin.options:
        counts = {kind: pairs[option, kind] for kind in failures.origin.kinds if pairs[option, kind]}
        total = sum(counts.values())
        table[option] = {"failures": total, "share": {kind: count / total for kind, count in counts.items()}}
    return table


def mode_table(clustering: Clustering, train: Failures, held_out_mode: IntArray, members: IntArray) -> pd.DataFrame:
    """One row per mode.

    Args:
        clustering: of the training failures.
        train: the training failures.
        held_out_mode: [H] modes of the held-out failures, by the classifier.
        members: [K] the typical member of each mode, an index into `train`.

    Returns:
        mode, size, weight |ρ_f|/Σ|ρ|, held_out (number), typical, probability (mean of the members'), then shares of
        kinds (`kind:<name>`) and options (`option:<name>`), then means of features (`mean:<column>`).
    """
    modes = clustering.modes
    values = modes.features(train.truth)
    kinds, options = np.array(train.kind_names()), np.array(train.option_names())
    rows = []
    for mode, (size, weight) in enumerate(zip(modes.sizes.tolist(), modes.share.tolist(), strict=True)):
        mine = clustering.mode == mode
        row: dict[str, Any] = {"mode": mode, "size": size, "weight": weight}
        row |= {"held_out": int((held_out_mode == mode).sum()), "typical": int(members[mode])}
        row["probability"] = float(clustering.probability[mine].mean())
        row |= {f"kind:{kind}": float((kinds[mine] == kind).mean()) for kind in train.origin.kinds}
        row |= {f"option:{option}": float((options[mine] == option).mean()) for option in train.origin.options}
        means = values[mine].mean(axis=0)
        row |= {f"mean:{column}": float(value) for column, value in zip(modes.columns, means, strict=True)}
        rows.append(row)
    return pd.DataFrame(rows)


def cluster_summary(clustering: Clustering, train: Failures, held_out: Failures, table: pd.DataFrame) -> dict[str, Any]:
    """Counts of executions and failures, BIC by number of modes, and the modes; `table` is that of `mode_table`."""
    return {
        "strategy": train.origin.strategy,
        "executions": train.origin.executions,
        "failures": len(train),
        "held_out": len(held_out),
        "bic": {str(number): value for number, value in clustering.bic.items()},
        "modes": table.to_dict("records"),
    }
