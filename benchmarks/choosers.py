"""Choosers of the recovery to train next, on made-up skill graphs and learning curves whose truth is known.

  python -m benchmarks.choosers                                   every chooser, six kinds of graph, ten seeds each
  python -m benchmarks.choosers --cases door_like --choosers lookahead metareskill --seeds 3 --json out.json

A kind of graph (`CASES`) says how many failure modes there are and how uneven their sizes are, how many of the
recoveries are infeasible, and the budget in queries. Curves saturate exponentially, as a hyperbola, or after a slow
start; a query is solved by chance, and what it leads to is measured on 50 failures. `regret` is what the budget's best
plan would have reached beyond the chooser, in true value of failures, as a share of what that plan gains; the plan
knows every curve, and which queries are solved. Intervals (95 %) are Student's t over the seeds. The last rows are
geometric means over the kinds.

Choosers have the settings of `conf/chooser/`; where a budget does not cover their initial rounds they get as many of
these as it covers. Seeds from 1000 on were used for choosing settings, and are refused.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from omegaconf import OmegaConf

from benchmarks import report
from p2l.evaluation.statistics import t_interval
from p2l.metareskill.algorithm import learn
from p2l.metareskill.choosers.oracle import best_values
from p2l.metareskill.choosers.table import CHOOSERS, make_chooser
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.history import Trained
from p2l.metareskill.value_iteration import value_of_failures
from p2l.records import Array, BoolArray

CONF = Path(__file__).resolve().parents[1] / "conf" / "chooser"
TARGETS = 4
MEASURED = 50  # failures behind a measured success rate
CHOSEN_ON = 1000  # seeds from here on


@dataclass(frozen=True)
class Case:
    """A kind of graph.

    Attributes:
        modes: failure modes, each with `TARGETS` recoveries.
        skew: sizes of the modes fall as a power of their rank; 0: all alike.
        infeasible: share of recoveries that hardly ever work.
        budget: queries.
    """

    modes: int
    skew: float
    infeasible: float
    budget: int


CASES = {
    "door_like": Case(modes=3, skew=2.0, infeasible=0.3, budget=100),
    "even": Case(modes=5, skew=0.0, infeasible=0.3, budget=100),
    "uneven": Case(modes=5, skew=1.0, infeasible=0.6, budget=100),
    "many": Case(modes=20, skew=1.0, infeasible=0.5, budget=200),
    "many_short": Case(modes=20, skew=1.0, infeasible=0.5, budget=120),
    "short": Case(modes=3, skew=1.0, infeasible=0.5, budget=20),
}


@dataclass(frozen=True)
class MadeUp:
    """A graph of a kind, and what every query of every recovery would lead to.

    Attributes:
        graph: before any training.
        solved: [I, M, L] whether each query is solved.
        rates: [I, M, L] true success rate after it.
        measured: [I, M, L] the rate that is seen.
    """

    graph: SkillGraph
    solved: BoolArray
    rates: Array
    measured: Array

    @classmethod
    def of(cls, case: Case, seed: int) -> MadeUp:
        """Drawn by a seed."""
        rng = np.random.default_rng(seed)
        sizes = np.maximum(rng.permutation(100.0 * np.arange(1.0, case.modes + 1.0) ** -case.skew), 1.0)
        shape = (case.modes, TARGETS)
        graph = SkillGraph(rng.uniform(0.85, 0.99, TARGETS - 1), sizes, np.zeros(shape))
        works = rng.random(shape) >= case.infeasible
        chance = np.where(works, rng.beta(4.0, 2.0, shape), rng.beta(1.0, 12.0, shape))
        ceiling = np.where(works, rng.uniform(0.4, 1.0, shape), rng.uniform(0.0, 0.15, shape))
        form, pace = rng.integers(3, size=shape)[..., None], rng.uniform(1.0, 8.0, shape)[..., None]
        n = np.arange(case.budget + 1)
        late = np.where(n > 0, 1.0 / (1.0 + np.exp((pace - n) / 1.5)), 0.0)
        share = np.where(form == 0, 1.0 - np.exp(-n / pace), np.where(form == 1, n / (n + pace), late))
        solved = rng.random((*shape, case.budget)) < chance[..., None]
        rates = np.take_along_axis(ceiling[..., None] * share, solved.cumsum(axis=-1), axis=-1)
        return cls(graph, solved, rates, rng.binomial(MEASURED, rates) / MEASURED)

    def train(self, mode: int, target: int, before: int) -> Trained:
        """What Algorithm 3's training reports; an unsolved query leaves the last measurement."""
        well = np.flatnonzero(self.solved[mode, target, : before + 1])
        q = float(self.measured[mode, target, well[-1]]) if len(well) else 0.0
        return Trained(q=q, trials=MEASURED, solved=bool(self.solved[mode, target, before]))


def regret(case: Case, chooser: str, seed: int) -> float:
    """Share of the best plan's gain in true value of failures that a chooser misses."""
    made = MadeUp.of(case, seed)
    rule = make_chooser(chooser, _settings(chooser, case))
    best: Array = np.zeros(made.graph.q.shape)
    true: Array = np.zeros(made.graph.q.shape)
    count = np.zeros(made.graph.q.shape, dtype=np.int64)
    *_, history = learn(made.graph, rule, made.train, rounds=case.budget, rng=np.random.default_rng(seed))
    for each in history.rounds:
        pair = each.mode, each.target
        if each.solved and each.q >= best[pair]:  # the skill that is kept; of equals the later one
            best[pair], true[pair] = each.q, made.rates[(*pair, count[pair])]
        count[pair] += 1
    start, reached = (float(value_of_failures(made.graph, q)) for q in (made.graph.q, true))
    most = float(best_values(made.graph, made.rates, case.budget)[-1])
    return (most - reached) / (most - start)


def _settings(chooser: str, case: Case) -> dict[str, Any]:
    plain = OmegaConf.to_container(OmegaConf.load(CONF / f"{chooser}.yaml"))["params"]
    if "initial_rounds" in plain:
        plain["initial_rounds"] = min(plain["initial_rounds"], case.budget // (case.modes * TARGETS))
    return dict(plain)


def summary(case: str, chooser: str, regrets: Array) -> report.Row:
    """One row."""
    found = t_interval(regrets)
    row = {"case": case, "chooser": chooser, "seeds": len(regrets)}
    return row | {"regret": found.mean, "low": found.low, "high": found.high}


def measure(cases: list[str], choosers: list[str], seeds: int) -> list[report.Row]:
    """All rows."""
    rows: list[report.Row] = []
    means: dict[str, list[float]] = {chooser: [] for chooser in choosers}
    for case in cases:
        for chooser in choosers:
            regrets = np.array([regret(CASES[case], chooser, seed) for seed in range(seeds)])
            rows.append(summary(case, chooser, regrets))
            means[chooser].append(float(regrets.mean()))
    for chooser in choosers:
        geometric = math.exp(float(np.mean(np.log(np.maximum(means[chooser], 1e-9)))))
        rows.append({"case": "geometric mean", "chooser": chooser, "seeds": seeds, "regret": geometric})
    return rows


def _seeds(text: str) -> int:
    if (number := report.positive(text)) < 2 or number > CHOSEN_ON:
        raise argparse.ArgumentTypeError(f"{text} given; an interval needs from 2 to {CHOSEN_ON} seeds")
    return number


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    known = [name for name in CHOOSERS.names() if name != "oracle"]
    parser = report.parser(__doc__)
    parser.add_argument("--cases", nargs="+", choices=list(CASES), default=list(CASES))
    parser.add_argument("--choosers", nargs="+", choices=known, default=known)
    parser.add_argument("--seeds", type=_seeds, default=10)
    args = parser.parse_args(arguments)
    report.finish(measure(args.cases, args.choosers, args.seeds), args.json)


if __name__ == "__main__":
    report.command(main)
