"""Ways of asking a person about their costs, side by side: `preferences_3.csv` and its figure (thesis, section 6.2.2).

Rows of measurements: domain, regime, c_ask, set, kind, person, policy, questions, plan_cost. People of one task set are
alike in what is to be done, so intervals are over sets, of the mean over the people of each.
"""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from p2l.evaluation.statistics import paired_difference, t_interval
from p2l.evaluation.style import COST, plain

OURS = "worth"
LABELS = {
    "nothing": ("ask nothing", "#E69F00"),
    "everything": ("ask everything", "#D55E00"),
    "uncertain": ("most uncertain", "#CC79A7"),
    "worth_alone": ("worth, families alone", "#56B4E9"),
    "worth": ("worth (ours)", "#0072B2"),
    "known": ("costs known for free", "#555555"),
}
_CASE = ["domain", "regime", "c_ask", "kind"]


def preference_table(rows: pd.DataFrame) -> pd.DataFrame:
    """A row per domain, regime, c_ask, kind (and `all`) and policy; ours minus each policy with 95 % intervals.

    Total cost is that of the plan and of the questions. `minus_*` is the paired difference, ours less the row's policy.
    """
    both = pd.concat([rows, rows.assign(kind="all")], ignore_index=True)
    both["total"] = both["plan_cost"] + both["c_ask"] * both["questions"]
    table = []
    for case, group in both.groupby(_CASE, sort=False):
        totals = group.pivot_table(index="set", columns="policy", values="total")
        for policy in (name for name in LABELS if name in totals):
            own = group[group["policy"] == policy]
            spread = t_interval(totals[policy].to_numpy())
            gain = paired_difference(totals[OURS].to_numpy(), totals[policy].to_numpy())
            table.append(
                dict(zip(_CASE, case, strict=True))
                | {
                    "policy": policy,
                    "people": len(own),
                    "sets": len(totals),
                    "questions": own["questions"].mean(),
                    "plan_cost": own["plan_cost"].mean(),
                    "total": float(spread.mean),
                    "total_low": float(spread.low),
                    "total_high": float(spread.high),
                    "minus": float(gain.mean),
                    "minus_low": float(gain.low),
                    "minus_high": float(gain.high),
                }
            )
    return pd.DataFrame(table)


def preference_figure(table: pd.DataFrame, c_ask: float, regime: str) -> Figure:
    """Total cost by kind of people and policy, and how many questions were asked, a column per domain."""
    shown = table[(table["c_ask"] == c_ask) & (table["regime"] == regime)]
    domains, kinds = list(dict.fromkeys(shown["domain"])), [*dict.fromkeys(shown["kind"])]
    figure = Figure(figsize=(5.2 * len(domains), 6.2), layout="constrained")
    axes = figure.subplots(2, len(domains), squeeze=False, height_ratios=[2.2, 1.0])
    for column, domain in enumerate(domains):
        own = shown[shown["domain"] == domain]
        above, below = axes[:, column]
        policies = [name for name in LABELS if name in set(own["policy"])]
        for number, policy in enumerate(policies):
            rows = own[own["policy"] == policy].set_index("kind").loc[kinds]
            label, colour = LABELS[policy]
            place = np.arange(len(kinds)) + (number - (len(policies) - 1) / 2.0) * 0.8 / len(policies)
            width = 0.74 / len(policies)
            reach = np.stack([rows["total"] - rows["total_low"], rows["total_high"] - rows["total"]])
            above.bar(place, rows["total"], width, color=colour, label=label, yerr=reach, error_kw={"lw": 0.8})
            below.bar(place, rows["questions"], width, color=colour)
        above.set_title(f"{domain}, {own['sets'].iloc[0]} sets, question {c_ask:g}")
        above.set_ylabel(f"total {COST}")
        below.set_ylabel("questions asked")
        for each in (above, below):
            plain(each)
            each.set_xticks(range(len(kinds)), kinds)
    figure.legend(*axes[0, 0].get_legend_handles_labels(), ncols=len(LABELS), loc="outside lower center", fontsize=9)
    return figure
