"""Planning for an uncertain tomorrow on the sets of chapter 3, from the truths that the thesis preset has recorded.

    python scripts/tomorrow_table.py results/thesis [insertion lego]

Nothing is simulated: a truth that is not among the records is refused. Writes tables/tomorrow_3.csv.
"""

from __future__ import annotations

import sys
from itertools import product
from pathlib import Path
from typing import Any

import pandas as pd
from hydra import compose, initialize_config_dir

from p2l.artifacts import atomic, config_hash
from p2l.domains.table import make_domain
from p2l.errors import ArtifactError
from p2l.evaluation.team.tomorrow_table import tomorrow_table
from p2l.ledger import Item, find
from p2l.schema import EvaluateTeamConfig, resolve, validate
from p2l.team.execute import TRUTH_VERSION, Truth
from p2l.team.study import Block, make_block, task_sets
from p2l.team.tomorrow.study import KINDS, compare

DOMAINS = ("insertion", "lego")
SAMPLES, HELD_OUT = 100, 50


def config_of(domain: str) -> EvaluateTeamConfig:
    """The configuration of the thesis preset."""
    with initialize_config_dir(str(Path("conf").resolve()), version_base="1.3"):
        plain = resolve(compose(config_name="evaluate_team", overrides=[f"domain={domain}", "experiment=thesis"]))
    return validate(plain, EvaluateTeamConfig, "conf/evaluate_team.yaml")


def truth_of(cfg: EvaluateTeamConfig, block: Block, records: Path) -> Truth:
    """The recorded truth of a block.

    Raises:
        ArtifactError: there is none.
    """
    identity = config_hash([TRUTH_VERSION, cfg.identity, block.digest])
    item = Item(cfg.domain.name, "truth", cfg.seed, block.index, identity)
    if (record := find(records, item)) is None:
        raise ArtifactError(f"{records / item.file}: no truth of these tasks; run scripts/thesis.sh")
    return Truth(record["planning"], record["executing"])


def rows_of(domain: str, records: Path) -> list[dict[str, Any]]:
    """Every method on every set, regime and kind of futures."""
    cfg = config_of(domain)
    study, world = cfg.study.study(), make_domain(cfg.domain.key, cfg.domain.params)
    rows: list[dict[str, Any]] = []
    for index in range(study.blocks):
        block = make_block(world, study, cfg.seed, index)
        truth = truth_of(cfg, block, records)
        for task_set, regime, kind in product(task_sets(study, cfg.seed, block), study.regimes, KINDS):
            rows += compare(cfg.seed, block, task_set, regime, truth, kind, SAMPLES, HELD_OUT)
    return rows


def main(results: Path, domains: tuple[str, ...] = DOMAINS) -> None:
    """Read the records of `results`, write its table."""
    tables = [tomorrow_table(pd.DataFrame(rows_of(each, results / "records")), each) for each in domains]
    with atomic(results / "tables" / "tomorrow_3.csv") as temporary:
        pd.concat(tables, ignore_index=True).to_csv(temporary, index=False, float_format="%.6g")


if __name__ == "__main__":
    main(Path(sys.argv[1]), tuple(sys.argv[2:]) or DOMAINS)
