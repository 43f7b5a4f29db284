"""Which encoding of pairs an insertion domain has by itself, chosen on seeds that no result is reported of.

    python scripts/choose_predictor.py <folder with <domain>-s<seed>/transfer_data.npz> results/thesis

For each domain and encoding a predictor is fitted to what one seed collected and judged by what the other collected:
its loss on all of that seed's pairs, and the cost of ADL's plans for sets of 20 of its 30 taught tasks, of which the
success of every lesson on every task is known; the other 10 are what the robot is pre-trained with, predicted or known.
Writes predictor_choice.csv.
"""

from __future__ import annotations

import sys
from itertools import permutations
from pathlib import Path

import numpy as np
import pandas as pd

from p2l.artifacts import atomic, load_arrays
from p2l.contracts.domain import Encoding, Tasks
from p2l.records import Array, TransferData
from p2l.seeding import generator, torch_seed
from p2l.team.problem import Decision
from p2l.team.study import Regime, make_problem, solve
from p2l.transfer.calibration import auc, log_loss
from p2l.transfer.fitting import FitOptions, fit_best, split_tasks
from p2l.transfer.model import TransferModel

SEEDS = (101, 102)
DOMAINS = ("insertion", "insertion_continuous")
ENCODINGS: tuple[Encoding, ...] = ("difference", "concatenation", "walls")
REGIME = Regime("high_teaching", 10.0, 100.0, 100.0, 200.0, (0, 10))
SETS, SET_SIZE = 40, 20
OPTIONS, DECAYS = FitOptions(epochs=600), (0.03, 0.1, 0.3)  # conf/fit_transfer.yaml at thesis scale


def fitted(data: TransferData, encoding: Encoding, seed: int) -> TransferModel:
    """A model as the stage `fit_transfer` fits it."""
    split = split_tasks(data, 0.2, OPTIONS.members, generator(seed, "choose_predictor", "split"))
    return fit_best(data, encoding, split, OPTIONS, DECAYS, torch_seed(seed, "choose_predictor", "weights"))[0].model


def mean_cost(data: TransferData, lessons: Array, skills: Array, level: int, seed: int) -> float:
    """Executed cost of ADL on sets of the taught tasks.

    Args:
        data: the true success rates.
        lessons: [K, K] what plans take lessons to be worth among the taught tasks.
        skills: [K, K] the same of skills that the robot has.
        level: number of those.
        seed: of the sets.
    """
    taught = Tasks(data.names, data.features, data.group).take(data.train_task)
    true, total = data.rate[:, data.train_task], 0.0
    for index in range(SETS):
        order = generator(seed, "choose_predictor", "set", index).permutation(len(taught))
        rows, known = order[:SET_SIZE], order[SET_SIZE : SET_SIZE + level]
        problem, skill = make_problem(
            REGIME, taught.take(rows), lessons[np.ix_(rows, rows)], skills[np.ix_(known, rows)]
        )
        plan = solve(problem, "adl", 0.0, 60.0)
        own = np.array([true[known[best], task] if best >= 0 else 0.0 for best, task in zip(skill, rows, strict=True)])
        success = np.where(plan.skill >= 0, true[rows[np.maximum(plan.skill, 0)], rows], own)
        price = {Decision.LEARN: REGIME.c_demo, Decision.DELEGATE: REGIME.c_hum}
        attempts = REGIME.c_rob + REGIME.c_fail * (1.0 - success)
        total += sum(price.get(Decision(code), cost) for code, cost in zip(plan.decision, attempts, strict=True))
    return total / SETS


def main(collected: Path, results: Path) -> None:
    """Read `collected`, write the table to `results`."""
    rows = []
    for domain in DOMAINS:
        paths = {seed: collected / f"{domain}-s{seed}" / "transfer_data.npz" for seed in SEEDS}
        data = {
            seed: TransferData.from_arrays(load_arrays(path, schema="transfer_data", version=1))
            for seed, path in paths.items()
        }
        for first, second in permutations(SEEDS, 2):
            judge = data[second]
            true = judge.rate[:, judge.train_task]
            tables: dict[str, Array] = {"truth": judge.rate}
            for encoding in ENCODINGS:
                model = fitted(data[first], encoding, first)
                tables[encoding] = model.predict(judge.features[judge.train_task], judge.features)
            for name, table in tables.items():
                pairs = table.ravel(), judge.successes.ravel(), judge.draws
                among = table[:, judge.train_task]
                costs = [mean_cost(judge, among, skills, level, second) for skills, level in _knowledge(among, true)]
                rows.append((domain, name, first, second, float(log_loss(*pairs)), float(auc(*pairs)), *costs))
    columns = ["domain", "encoding", "fitted_seed", "judged_seed", "log_loss", "auc"]
    columns += ["cost_0", "cost_10_predicted", "cost_10_measured"]
    with atomic(results / "tables" / "predictor_choice.csv") as temporary:
        pd.DataFrame(rows, columns=columns).to_csv(temporary, index=False, float_format="%.6g")


def _knowledge(predicted: Array, true: Array) -> tuple[tuple[Array, int], ...]:
    """What is taken for the success of pre-trained skills, and how many there are."""
    return (predicted, 0), (predicted, 10), (true, 10)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
