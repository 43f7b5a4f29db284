"""Make features.csv, trials.csv and orders.csv of a made-up shop: python -m examples.shop.make [folder].

28 tasks of 9 families. The hidden truth, which no file tells: a skill taught on i solves j with probability
sigmoid(2.5 - 2.5 [other family] - 0.8 [other material] - 0.8 |log2 ratio of diameters| - 0.2 |log2 ratio of lengths|
- 1.2 max(0, log2(clearance of i / clearance of j)) + e), e normal of deviation 0.4: what was learnt on a tight fit
does on a loose one, and not the other way round. A pair is tried 1 to 5 times.
"""

import csv
import sys
from pathlib import Path

import numpy as np

SHOP = Path(__file__).parent
FAMILIES = {  # tasks, diameter in mm, length in mm, clearance in µm, mass in kg, chance of a demonstration's cost
    "peg": (5, 8, 40, 60, 0.10), "gear": (3, 30, 12, 40, 0.20), "connector": (4, 12, 20, 150, 0.03),
    "screw": (4, 5, 16, 120, 0.01), "clip": (3, 10, 15, 400, 0.02), "bearing": (3, 22, 8, 15, 0.08),
    "cover": (2, 80, 5, 600, 0.40), "cable": (2, 6, 200, 800, 0.15), "spring": (2, 9, 35, 500, 0.02),
}  # fmt: skip
CATALOGUE = ("peg_5", "connector_4", "screw_4")  # lessons that could be given, and no orders of today
FEATURES = ("diameter_mm", "length_mm", "clearance_um", "mass_kg")


def tasks(rng):
    """Rows of features.csv."""
    rows = []
    for family, (count, *typical) in FAMILIES.items():
        for number in range(1, count + 1):
            values = np.array(typical) * 2.0 ** rng.uniform(-1, 1, 4)
            material = str(rng.choice(["steel", "aluminium", "plastic"], p=[0.4, 0.3, 0.3]))
            rounded = [float(f"{value:.3g}") for value in values]
            rows.append([f"{family}_{number}", *rounded, material, family])
    return rows


def truth(rows, rng):
    """[M, M] probability that the skill of a row's task solves a column's."""
    size = np.log2(np.array([row[1:5] for row in rows]))
    change = size[None] - size[:, None]  # tested minus taught
    other = [np.array([row[at] for row in rows])[:, None] != np.array([row[at] for row in rows]) for at in (6, 5)]
    logit = 2.5 - 2.5 * other[0] - 0.8 * other[1] - np.abs(change) @ [0.8, 0.2, 0, 0]
    logit += 1.2 * np.minimum(0, change[..., 2]) + 0.4 * rng.standard_normal(other[0].shape)
    return 1 / (1 + np.exp(-logit))


def main(folder=SHOP, seed=7, n_trials=60):
    """Write the three files; returns the hidden truth."""
    rng = np.random.default_rng(seed)
    rows = tasks(rng)
    p = truth(rows, rng)
    family = np.array([row[6] for row in rows])
    odds = np.where(family[:, None] == family, 12.0, 1.0).ravel()  # who tries, tries what looks alike
    pairs = rng.choice(p.size, n_trials, replace=False, p=odds / odds.sum())
    trials = [["taught", "tested", "successes", "attempts"]]
    for pair, n in zip(np.sort(pairs).tolist(), rng.integers(1, 6, n_trials).tolist(), strict=True):
        taught, tested = divmod(pair, len(rows))
        trials.append([rows[taught][0], rows[tested][0], rng.binomial(n, p[taught, tested]), n])
    orders = [["task", "c_rob", "c_hum", "c_fail", "c_demo", "pretrained", "family", "count"]]
    for row in rng.permutation(np.array([row for row in rows if row[0] not in CATALOGUE], dtype=object)).tolist():
        minutes = [int(rng.integers(*span)) for span in ((1, 4), (8, 15), (8, 20), (15, 30))]
        orders.append([row[0], *minutes, 0.8 if row[6] == "cover" else 0, row[6], int(rng.integers(1, 5))])
    for name, table in (("features", [["task", *FEATURES, "material", "family"], *rows]), ("trials", trials), ("orders", orders)):  # fmt: skip
        with (Path(folder) / f"{name}.csv").open("w", encoding="utf-8", newline="") as stream:
            csv.writer(stream, lineterminator="\n").writerows(table)
    return p


if __name__ == "__main__":
    main(*sys.argv[1:])
