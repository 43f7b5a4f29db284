"""What a transfer table from few trials is worth, on made-up shops (`examples/shop`) whose truth is known.

  python -m benchmarks.few_trials                                 twelve shops, 20 and 60 tried pairs
  python -m benchmarks.few_trials --shops 3 --pairs 20 --json out.json

Per number of tried pairs, means over the shops: `coverage` is the share of pairs whose truth lies in the 90 % interval
of the chosen model, `lowest` that of the worst shop, `loss` the log loss against the truth and `loss_rates` that of
success by kind of pair. `excess` is what the plan made from the table truly costs beyond the best plan, in minutes;
`by_worth` and `by_chance` the same after eight more trials of three attempts, chosen by their worth, or at random
within families. The model of these three is always `logistic`, which is not compared anew after each trial, for speed.
"""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from benchmarks import report
from examples.shop import make
from p2l.records import Array
from p2l.team.information import Stake, cost_of, trial_values
from p2l.team.planners import plan
from p2l.team.trial_files import read_features, read_orders, read_trials
from p2l.transfer.few_trials import SAME_FAMILY, Prior, Trials, all_pairs
from p2l.transfer.pair_models import MODELS, FitSetting, rates
from p2l.transfer.prediction import predict

STEPS, ATTEMPTS = 8, 3
FEWEST = 25  # as in conf/predict_transfer.yaml


class Shop:
    """One made-up shop: its truth, its first trials and its orders."""

    def __init__(self, seed: int, pairs: int) -> None:
        with TemporaryDirectory() as folder:
            self.p: Array = make.main(folder, seed, pairs)
            features = Path(folder) / "features.csv"
            tasks = read_features(features)
            self.trials = read_trials(Path(folder) / "trials.csv", tasks.names, features)
            self.problem, self.place = read_orders(Path(folder) / "orders.csv", tasks.names, features, "fixed")
        self.seed, self.m, self.setting = seed, len(tasks.names), FitSetting(tasks, Prior(), 20)
        self.query = all_pairs(tasks)

    def scores(self) -> dict[str, float]:
        """Coverage of the chosen model, and log losses against the truth."""
        rng = np.random.default_rng(self.seed)
        table = predict(self.setting, self.trials, tuple(MODELS), 5, FEWEST, 0.9, rng=rng)
        held = (table.low <= self.p) & (self.p <= table.high)
        base = rates(self.setting, self.trials, self.query, rng).mean.reshape(self.p.shape)
        loss = [-(self.p * np.log(p) + (1 - self.p) * np.log1p(-p)).mean() for p in (table.p, base)]
        return {"coverage": float(held.mean()), "loss": float(loss[0]), "loss_rates": float(loss[1])}

    def excess(self, by_worth: bool) -> tuple[float, float]:
        """What the plan costs beyond the best one before and after more trials, in truth."""
        rng, trials, costs = np.random.default_rng(self.seed), self.trials, []
        for step in range(STEPS + 1):
            belief = MODELS["logistic"](self.setting, trials, self.query, rng)
            stake = Stake(self.problem, self.place, belief, self.m)
            today = plan(stake.today)
            truth = stake.expected(self.p.ravel()[stake.index])
            costs.append(cost_of(truth, today) - plan(truth).objective)
            if step < STEPS:
                cells = np.unique(stake.index)
                pair = int(rng.choice(cells[self.query.group[cells] == SAME_FAMILY]))
                if by_worth and (best := trial_values(stake, today, largest=1, attempts=(1, 2, ATTEMPTS))):
                    pair = best[0].taught * self.m + best[0].tested
                taught, tested = divmod(pair, self.m)
                row = (taught, tested, rng.binomial(ATTEMPTS, self.p[taught, tested]), ATTEMPTS)
                old = (trials.taught, trials.tested, trials.successes, trials.attempts)
                trials = Trials.pooled(*(np.append(column, cell) for column, cell in zip(old, row, strict=True)))
        return costs[0], costs[-1]


def measure(shops: int, pairs: int) -> dict[str, float]:
    """One row of the table."""
    rows = []
    for seed in range(100, 100 + shops):
        shop = Shop(seed, pairs)
        (excess, by_worth), (_, by_chance) = shop.excess(True), shop.excess(False)
        rows.append(shop.scores() | {"excess": excess, "by_worth": by_worth, "by_chance": by_chance})
    means = {name: float(np.mean([row[name] for row in rows])) for name in rows[0]}
    return {"pairs": pairs, "lowest": min(row["coverage"] for row in rows)} | means


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = report.parser(__doc__)
    parser.add_argument("--shops", type=report.positive, default=12)
    parser.add_argument("--pairs", type=report.positive, nargs="+", default=[20, 60])
    args = parser.parse_args(arguments)
    report.finish([measure(args.shops, pairs) for pairs in args.pairs], args.json)


if __name__ == "__main__":
    report.command(main)
