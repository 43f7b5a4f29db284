"""Make the tables of a made-up shop, and forecast.csv for tomorrow: python -m examples.shop.make [folder].

28 tasks of 9 families. The hidden truth, which no file tells: a skill taught on i solves j with probability
sigmoid(2.5 - 2.5 [other family] - 0.8 [other material] - 0.8 |log2 ratio of diameters| - 0.2 |log2 ratio of lengths|
- 1.2 max(0, log2(clearance of i / clearance of j)) + e), e normal of deviation 0.4. A pair is tried 1 to 5 times.
"""

import csv
import sys
from pathlib import Path

import numpy as np

FAMILIES = {  # tasks; typical diameter in mm, length in mm, clearance in µm, mass in kg
    "peg": (5, 8, 40, 60, 0.10), "gear": (3, 30, 12, 40, 0.20), "connector": (4, 12, 20, 150, 0.03),
    "screw": (4, 5, 16, 120, 0.01), "clip": (3, 10, 15, 400, 0.02), "bearing": (3, 22, 8, 15, 0.08),
    "cover": (2, 80, 5, 600, 0.40), "cable": (2, 6, 200, 800, 0.15), "spring": (2, 9, 35, 500, 0.02),
}  # fmt: skip
CATALOGUE = {"peg_5": 10, "connector_4": 17, "screw_4": 18}  # lessons that are on no order of today; minutes
COSTS = ((1, 4), (8, 15), (8, 20), (15, 30))  # minutes
BEFORE = (("peg", "bearing"), ("bearing", "gear"), ("gear", "cover"), ("connector", "cable"))  # of each machine
HEADERS = {"features": "task,diameter_mm,length_mm,clearance_um,mass_kg,material,family", "before": "before,after",
           "trials": "taught,tested,successes,attempts",
           "forecast": "task,mean,distribution", "robots": "robot,task,c_demo",
           "orders": "task,c_rob,c_hum,c_fail,c_demo,pretrained,family,count"}  # fmt: skip


def tasks(rng):
    """Rows of features.csv."""
    for family, (count, *typical) in FAMILIES.items():
        for number in range(1, count + 1):
            values = [float(f"{value:.3g}") for value in typical * 2.0 ** rng.uniform(-1, 1, 4)]
            yield [f"{family}_{number}", *values, str(rng.choice(["steel", "aluminium", "plastic"])), family]


def truth(rows, rng):
    """[M, M] probability that the skill of a row's task solves a column's, and [M, M] whether they are of a family."""
    change = (size := np.log2([row[1:5] for row in rows]))[None] - size[:, None]  # tested minus taught
    same_family, same_material = (np.array([[a[at] == b[at] for b in rows] for a in rows]) for at in (6, 5))
    logit = 2.5 - 2.5 * ~same_family - 0.8 * ~same_material - np.abs(change) @ [0.8, 0.2, 0, 0]
    logit += 1.2 * np.minimum(0, change[..., 2]) + 0.4 * rng.standard_normal(logit.shape)
    return 1 / (1 + np.exp(-logit)), same_family


def main(folder=Path(__file__).parent, seed=3, n_trials=60):
    """Write the files; returns the hidden truth."""
    rng = np.random.default_rng(seed)
    p, alike = truth(rows := list(tasks(rng)), rng)
    odds = np.where(alike, 12.0, 1.0) / np.where(alike, 12.0, 1.0).sum()  # who tries, tries what looks alike
    tried = np.sort(rng.choice(p.size, n_trials, replace=False, p=odds.ravel())).tolist()
    pairs = [(*divmod(pair, len(rows)), rng.integers(1, 6)) for pair in tried]
    trials = [[rows[i][0], rows[j][0], rng.binomial(n, p[i, j]), n] for i, j, n in pairs]
    orders = [[r[0], *(rng.integers(*span) for span in COSTS), 0.8 * (r[6] == "cover"), r[6], rng.integers(1, 4)]
              for r in rng.permutation(np.array(rows, dtype=object)).tolist() if r[0] not in CATALOGUE]  # fmt: skip
    kinds = ["poisson", "geometric"]
    expected = [[order[0], rng.choice([0, 0.5, 1, 3]), rng.choice(kinds)] for order in sorted(orders)]
    today = {order[0] for order in orders}
    arcs = [pair for a, b in BEFORE for k in "123" if today.issuperset(pair := (f"{a}_{k}", f"{b}_{k}"))]
    lessons = [("cobot", *lesson) for lesson in CATALOGUE.items()]
    tables = {"features": rows, "trials": trials, "orders": orders, "before": arcs, "forecast": expected,
              "robots": lessons}  # fmt: skip
    for name, table in tables.items():
        with (Path(folder) / f"{name}.csv").open("w", encoding="utf-8", newline="") as stream:
            csv.writer(stream, lineterminator="\n").writerows([HEADERS[name].split(","), *table])
    return p


if __name__ == "__main__":
    main(*sys.argv[1:])
