"""Small hand-made results of a team study."""

from pathlib import Path

import pandas as pd

from p2l.evaluation.team.metrics import summarise

FOLDER = Path(__file__).parents[3] / "data" / "thesis"
METHODS = ("adl", "ad", "cba", "cba_best", "alm", "adl_any", "adl_true")
ZERO = {"demos": 0.0, "delegated": 0.0, "attempts": 0.0, "failures": 0.0, "n_tasks": 10.0}


def row(method, index, cost, regime="high_teaching", level=0, **counts):
    given = {"block": index, "set": index, "regime": regime, "level": level, "method": method}
    costs = {"predicted_cost": cost - 1.0, "executed_cost": cost}
    return {**given, **costs, **ZERO, **counts}


def results(costs, regime="high_teaching", level=0):
    """A row per method and set; `costs`: method → executed cost of each set."""
    return pd.DataFrame(
        [row(method, index, cost, regime, level) for method, each in costs.items() for index, cost in enumerate(each)]
    )


def study(levels=(0, 2), regimes=("high_teaching", "low_teaching")):
    """ADL costs 100 less than every other method, but the same at the last level; three sets."""
    frames = []
    for regime in regimes:
        for level in levels:
            lead = 0.0 if level == levels[-1] else 100.0
            costs = {method: [800.0 + lead, 900.0 + lead, 1000.0 + lead] for method in METHODS}
            costs["adl"] = [800.0, 900.0, 1000.0]
            costs["adl_any"] = [700.0, 850.0, 960.0]
            costs["adl_true"] = [790.0, 890.0, 990.0]
            frames.append(results(costs, regime, level))
    return pd.concat(frames, ignore_index=True)


def summary(frame):
    return summarise(frame)


def plans(regime, level=0, names=("0", "2", "12"), sets=3):
    """ADL's and AD's plans: learn the first task, attempt the second with its skill, delegate the third."""
    done = list(zip(names, ("learn", "act", "delegate"), (0, 0, -1), strict=True))
    rows = [
        {"block": 0, "set": index, "regime": regime, "level": level, "method": method, "step": step, "task": step,
         "name": name, "decision": decision, "skill": skill, "p_success": 1.0, "predicted_cost": 1.0, "identity": "x"}
        for method in ("adl", "ad")
        for index in range(sets)
        for step, (name, decision, skill) in enumerate(done)
    ]  # fmt: skip
    return pd.DataFrame(rows)
