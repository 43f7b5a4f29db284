"""Readings of the claims of chapter 5 against our data."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import pandas as pd

from p2l.evaluation.chaining.figures import BESIDE_MAIN, MAIN
from p2l.evaluation.page.page import Agreement, Reading

Claims = Mapping[tuple[str, str], str]
Cells = Mapping[tuple[str, str, str], Mapping[Any, Any]]
UNABLE = 0.05  # "not able to solve the task at all"
RIVAL, FLAT, LAZY = "pp", "rl", "lazy_rc"


def percent(row: Mapping[Any, Any]) -> str:
    """A rate with its interval."""
    mean, low, high = (100.0 * float(row[key]) for key in ("mean", "low", "high"))
    return f"{mean:.1f} [{low:.1f}, {high:.1f}] %"


def of_worlds(claims: Claims, cells: Cells) -> list[Reading]:
    """Whether RC does as well as the thesis's, and better than the nominal skills, world by world."""
    readings = []
    for setting in dict.fromkeys(key[0] for key in cells):
        ours, base = (cells.get((setting, method, "success")) for method in (MAIN, "nominal"))
        world = setting.removeprefix("world=")
        claim = claims.get(("table_5_1", world), "")
        if ours is None or base is None:
            readings.append(Reading(claim, f"{world}: RC was not trained."))
            continue
        better = _apart(cells, setting, MAIN, "nominal")
        agrees: Agreement = "no"
        if better:
            agrees = "partly" if ours["mean"] < ours["thesis"] else "yes"
        recovery = cells[setting, MAIN, "recovery"]
        text = (
            f"{world}: nominal {percent(base)}, with RC {percent(ours)}; "
            f"{percent(recovery)} of the failures are recovered."
        )
        readings.append(Reading(claim, text, agrees if claim else "unsaid"))
    return readings


def of_order(claims: Claims, cells: Cells) -> list[Reading]:
    """Whether RC is above PP, intervals apart, and RL solves nothing, in every world that has them."""
    texts, verdicts = [], []
    for setting in dict.fromkeys(key[0] for key in cells):
        rates = [cells.get((setting, method, "success")) for method in (MAIN, RIVAL, FLAT)]
        if rates[0] is None or rates[1] is None:
            continue
        ours, rival, flat = rates[0], rates[1], rates[2]
        apart = _apart(cells, setting, MAIN, RIVAL)
        unable = flat is None or bool(flat["mean"] <= UNABLE)
        verdicts.append((apart, unable, bool(ours["mean"] > rival["mean"])))
        rest = "" if flat is None else f", RL {percent(flat)}"
        texts.append(f"{setting.removeprefix('world=')}: RC {percent(ours)}, PP {percent(rival)}{rest}")
    claim = claims["table_5_1", "order"]
    if not texts:
        return [Reading(claim, "RC and PP were not both trained; the thesis preset trains both.")]
    agrees: Agreement = "no"
    if all(apart and unable for apart, unable, _ in verdicts):
        agrees = "yes"
    elif all(above for *_, above in verdicts):
        agrees = "partly"
    return [Reading(claim, f"{'; '.join(texts)}.", agrees)]


def of_laziness(cells: Cells) -> list[str]:
    """Lazy RC less RC, world by world, where several seeds give the difference an interval."""
    texts = []
    for (setting, method, metric), row in cells.items():
        if method == LAZY and metric == BESIDE_MAIN and row["n"] > 1:
            mean, low, high = (100.0 * float(row[key]) for key in ("mean", "low", "high"))
            world = setting.removeprefix("world=")
            texts.append(f"{world} {mean:+.1f} [{low:+.1f}, {high:+.1f}]")
    if not texts:
        return []
    return [f"Overall success of Lazy RC less that of RC, paired by seed, in percentage points: {'; '.join(texts)}."]


def _apart(cells: Cells, setting: str, better: str, worse: str) -> bool:
    """Whether one method is above another, 95 % intervals apart."""
    high, low = (cells[setting, method, "success"] for method in (better, worse))
    return bool(float(high["low"]) > float(low["high"]))


def of_progress(claims: Claims, curves: pd.DataFrame) -> list[Reading]:
    """What RC and PP gain in the second half of their training, from `figure_5_5`."""
    place = curves["setting"].str.extract(r"world=(?P<world>.*);control_steps=(?P<steps>\d+)")
    points = curves.assign(world=place["world"], steps=place["steps"].astype(float))
    texts, verdicts = [], []
    for world, rows in points.groupby("world", sort=False):
        late: dict[str, float] = {}
        for method in (MAIN, RIVAL):
            mine = rows[rows["method"] == method].sort_values("steps")["mean"].to_numpy()
            if len(mine) > 1:
                late[method] = float(mine[-1] - mine[len(mine) // 2])
                three = f"{mine[0]:.2f} at first, {mine[len(mine) // 2]:.2f} halfway, {mine[-1]:.2f} at last"
                texts.append(f"{world}, {method.upper()}: {three}")
        if len(late) == 2:
            verdicts.append(late[MAIN] > max(late[RIVAL], 0.0))
    agrees: Agreement = "unsaid"
    if verdicts:
        agrees = "yes" if all(verdicts) else "partly" if any(verdicts) else "no"
    return [Reading(claims["figure_5_5", "progress"], f"{'; '.join(texts)}.", agrees)] if texts else []


def of_commitment(claim: str, world: str, counts: pd.DataFrame) -> tuple[Reading, pd.DataFrame]:
    """Whether one option comes to be preferred, by one learner's counts (`figure_5_8`); and means of the last tenth."""
    number = counts["setting"].str.extract(r"round=(\d+)")[0].astype(int)
    tenth = max(1, (int(number.max()) + 1) // 10)
    first = counts[number < tenth].groupby("metric", sort=False)["mean"].mean()
    last = counts[number > number.max() - tenth].groupby("metric", sort=False)["mean"].mean()
    best = str(last.idxmax())
    before, after = (float(part[best] / max(part.sum(), 1e-9)) for part in (first, last))
    others = ", ".join(f"{str(name).replace('_', ' ')} {mean:.1f}" for name, mean in last.items())
    text = (
        f"{world}: {best.replace('_', ' ')} is {before:.0%} of the options chosen in the first tenth of the rounds and "
        f"{after:.0%} in the last; per round then {others}."
    )
    agrees: Agreement = "yes" if after >= 0.5 and after > before else "partly" if after > before + 0.1 else "no"
    rows = counts[number == number.max()].drop_duplicates("metric")
    means = rows["metric"].map(last).to_numpy(dtype=float)
    ends = rows.assign(mean=means, low=float("nan"), high=float("nan"), setting=f"world={world}")
    return Reading(claim, text, agrees), ends


def of_transfer(claim: str, rows: pd.DataFrame) -> Reading:
    """Recovery rates elsewhere, beside the thesis's where it has one."""
    texts = []
    for row in rows.to_dict("records"):
        where = str(row["setting"]).rpartition("=")[2].replace("_", " ")
        texts.append(f"{where} {percent(row)}" if row["n"] else f"{where}: no failure was induced")
    comparable = rows[rows["thesis"].notna() & (rows["n"] > 0)]
    agrees: Agreement = "unsaid"
    if len(comparable):
        above = comparable["mean"] >= comparable["thesis"]
        within = comparable["high"] >= comparable["thesis"]
        agrees = "yes" if above.all() else "partly" if within.any() else "no"
    return Reading(claim, f"{'; '.join(texts)}.", agrees)
