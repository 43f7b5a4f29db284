"""Ways of asking people whose costs are not known, on sets of the thesis preset: preferences_3.csv and its figure.

    python scripts/preferences_tables.py results/thesis

Needs the committed truth records, and simulates nothing. People are made up (`p2l.team.preferences.people`): of each
kind two for every set of insertion, one for every set of Lego. Families are insertion's environments and Lego's shapes.
Plans are made by one half of the simulated draws and judged by the other. What is done for a set is in
results/thesis/records/<domain>-preferences_<price>-…, and is not done again. `SEED` is of the people. Families, prices,
points and what is believed of kinds were chosen with people of another seed, 100.
"""

from __future__ import annotations

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from hydra import compose, initialize_config_dir

from p2l.artifacts import atomic, config_hash
from p2l.contracts.domain import Domain
from p2l.domains.table import make_domain
from p2l.evaluation.style import png
from p2l.evaluation.team.preferences import preference_figure, preference_table
from p2l.ledger import Item, find, write
from p2l.schema import EvaluateTeamConfig, resolve, validate
from p2l.seeding import generator
from p2l.team.execute import Truth, recorded_truth
from p2l.team.preferences.people import KINDS, POLICIES, meetings, stranger
from p2l.team.preferences.values import Optima
from p2l.team.shop import Shop
from p2l.team.study import Block, Regime, Study, TaskSet, make_block, make_problem, task_sets

ROOT = Path(__file__).resolve().parents[1]
VERSION = 1  # raise it when the same people would be asked otherwise
SEED, POINTS = 0, 8
PRICES = (20.0,)  # of a question, as in COIL
PEOPLE = {"insertion": 2, "lego": 1}  # of each kind, for every set
SHAPES = {"bar": "bars", "plate": "plates", "l": "corners", "u": "corners", "t": "crossings", "plus": "crossings",
          "s": "steps", "steps": "steps"}  # fmt: skip


def study_of(name: str) -> tuple[Domain, Study, EvaluateTeamConfig]:
    """The domain and the study of the thesis preset."""
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        composed = compose("evaluate_team", ["experiment=thesis", f"domain={name}", "plans=none"])
    config = validate(resolve(composed), EvaluateTeamConfig, f"domain={name}")
    return make_domain(config.domain.key, config.domain.params), config.study.study(), config


def families_of(name: str, block: Block, task_set: TaskSet) -> list[str]:
    """Family of each task of a set, in work order."""
    tasks = block.pool.take(task_set.tasks)
    if name == "lego":
        return [SHAPES[each.split("_")[0]] for each in tasks.names]
    return [f"environment {each}" for each in tasks.group.tolist()]


def rows_of(
    name: str, regimes: tuple[Regime, ...], block: Block, task_set: TaskSet, truth: Truth, price: float
) -> list[dict[str, Any]]:
    """Every policy with every person of a set, in every regime."""
    labels = families_of(name, block, task_set)
    families = tuple(dict.fromkeys(labels))
    member = np.array([families.index(each) for each in labels])
    pairs, pool = np.ix_(task_set.tasks, task_set.tasks), block.pool.take(task_set.tasks)
    rows = []
    for regime in regimes:
        planned, true = (
            Shop.of_problem(make_problem(regime, pool, table[pairs], np.zeros((0, len(labels))))[0])
            for table in (truth.planning, truth.executing)
        )
        optima = Optima(planned, stranger(member, families, POINTS))
        for kind in KINDS:
            for person in range(PEOPLE[name]):
                rng = generator(SEED, "preferences", name, task_set.index, kind.name, person)
                for met in meetings(optima, true, kind.costs(len(families), rng), price, POLICIES):
                    about = {"domain": name, "regime": regime.name, "c_ask": price, "set": task_set.index}
                    rows.append(about | {"kind": kind.name, "person": person} | vars(met))
    return rows


def recorded(name: str, records: Path, price: float) -> pd.DataFrame:
    """Rows of all sets of a domain, from their records where there are some."""
    domain, study, config = study_of(name)
    frames = []
    for index in range(study.blocks):
        block = make_block(domain, study, config.seed, index)
        truth = recorded_truth(domain, study, config.seed, block, records, config.identity)
        decisive = [VERSION, POINTS, PEOPLE[name], price, config.identity, block.digest, truth.executing.tolist()]
        item = Item(name, f"preferences_{price:g}", SEED, index, config_hash(decisive))
        if (record := find(records, item)) is None:
            start = time.perf_counter()
            [task_set] = task_sets(study, config.seed, block)
            record = pd.DataFrame(rows_of(name, study.regimes, block, task_set, truth, price)).to_dict("list")
            write(records, item, record, seconds=time.perf_counter() - start)
        frames.append(pd.DataFrame(record))
        if sys.stderr.isatty():
            sys.stderr.write(f"\r{name}, question {price:g}: {index + 1} of {study.blocks} sets ")
    return pd.concat(frames)


def main(results: Path) -> None:
    """Write the table and the figure."""
    rows = [recorded(name, results / "records", price) for price in PRICES for name in PEOPLE]
    table = preference_table(pd.concat(rows, ignore_index=True))
    with atomic(results / "tables" / "preferences_3.csv") as temporary:
        table.to_csv(temporary, index=False, float_format="%.6g")
    with atomic(results / "figures" / "preferences_3.png") as temporary:
        temporary.write_bytes(png(preference_figure(table, PRICES[0], "high_teaching")))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
