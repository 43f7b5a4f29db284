"""The tables and the figure of what scripts/thesis_predictor.sh has left: predictors of transfer side by side.

    python scripts/predictor_tables.py <its working folder> results/thesis

Writes predictor_3.csv and predictor_3.png, and replaces the rows of the new predictor (those with `predictor=` in their
setting) in figure_3_7.csv and figure_3_10_insertion.csv; every other byte of these two stays.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pandas as pd
import yaml  # type: ignore[import-untyped]

from p2l.artifacts import atomic, load_json, load_table, write_text
from p2l.contracts.domain import Domain
from p2l.domains.table import make_domain
from p2l.evaluation.style import png
from p2l.evaluation.team.predictors import PredictorVariant, comparison, further_rows, predictor_figure
from p2l.evaluation.team.tables import HIGH
from p2l.evaluation.transfer.planned import planned_predictions
from p2l.evaluation.transfer.scores import Predictions, records, score_table
from p2l.records import Array
from p2l.schema import EvaluateTeamConfig, validate
from p2l.seeding import generator
from p2l.team.execute import recorded_truth
from p2l.team.pretrained import recorded_pretrained
from p2l.team.study import Block, make_block
from p2l.transfer.model import load_transfer_model

DOMAINS = {"insertion": "Slots on the lattice", "insertion_continuous": "Slots anywhere"}
VARIANTS = (("difference", "predicted"), ("difference", "measured"), ("walls", "predicted"), ("walls", "measured"))
NAMES = {
    "predictor=difference;skills=predicted": "thesis's encoding",
    "predictor=difference;skills=measured": "thesis's, skills measured",
    "predictor=walls;skills=predicted": "walls",
    "predictor=walls;skills=measured": "walls, skills measured",
}
FURTHER = VARIANTS[2:]  # in the tables that the thesis's encoding has already


def variants_of(work: Path, ledger: Path, domain: str) -> list[PredictorVariant]:
    """The results of every variant, with scores on the pairs of its own plans and of the first variant's."""
    own = load_plans(work, domain, *VARIANTS[0])
    variants = []
    for encoding, skills in VARIANTS:
        folder = work / "evaluate_team" / f"{domain}-{encoding}-{skills}"
        config = validate(yaml.safe_load((folder / "config.yaml").read_text(encoding="utf-8")), EvaluateTeamConfig, "")
        world, study = make_domain(config.domain.key, config.domain.params), config.study.study()
        blocks = [make_block(world, study, config.seed, index) for index in range(study.blocks)]
        at = (study, config.seed)
        truths = {block.index: recorded_truth(world, *at, block, ledger, config.identity) for block in blocks}
        tables = {block.index: predicted(work, world, encoding, block) for block in blocks}
        if skills == "measured":
            for block in blocks:
                known = recorded_pretrained(world, *at, block, ledger, config.identity)
                tables[block.index][len(block.pool) :] = known
        plans = load_plans(work, domain, encoding, skills)
        groups = [planned_predictions(plans, truths, study.draws)]
        groups.append(renamed(planned_predictions(own, truths, study.draws, tables=tables), "planned_by_first"))
        scores = records(score_table(groups, generator(config.seed, "predictor_tables", domain, "intervals")))
        if skills == "predicted":
            fitted = work / "fit_transfer" / f"{domain}-{encoding}" / "metrics.json"
            held_out = load_json(fitted, schema="fit_transfer_metrics", version=1)["scores"]
            scores = [row for row in held_out if row["method"] == "model"] + scores
        results = load_table(folder / "results.parquet", schema="team_results", version=1)
        summary = load_table(folder / "summary.parquet", schema="team_summary", version=1)
        variants.append(PredictorVariant(encoding, skills, results, summary, scores))
    return variants


def load_plans(work: Path, domain: str, encoding: str, skills: str) -> pd.DataFrame:
    """Plans that were made with a variant."""
    return load_table(work / "plan" / f"{domain}-{encoding}-{skills}" / "plans.parquet", schema="plans", version=1)


def predicted(work: Path, world: Domain, encoding: Any, block: Block) -> Array:
    """[M + Q, M] predicted success of all of a block's skills on its pool."""
    path = work / "fit_transfer" / f"{world.name}-{encoding}" / "transfer_model.safetensors"
    model = load_transfer_model(path, feature_names=world.feature_names, encoding=encoding)
    return model.predict(block.pool.join(block.pretrained).features, block.pool.features)


def renamed(predictions: Predictions, pairs: str) -> Predictions:
    """The same predictions as another group of pairs."""
    return replace(predictions, pairs=pairs)


def replace_rows(path: Path, rows: pd.DataFrame) -> None:
    """Put rows at the end of a table in place of those that name a predictor."""
    text = path.read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [line for line in text if "predictor=" not in line]
    write_text(path, "".join(kept) + rows.to_csv(index=False, header=False, float_format="%.6g"))


def is_there(work: Path, domain: str) -> bool:
    """Whether all variants of a domain have been executed; a domain that is still in work has no rows yet."""
    places = [work / "evaluate_team" / f"{domain}-{encoding}-{skills}" for encoding, skills in VARIANTS]
    return all((place / "results.parquet").is_file() for place in places)


def main(work: Path, results: Path) -> None:
    """Read `work`, write to `results`."""
    tables = results / "tables"
    found = {domain: variants_of(work, results / "records", domain) for domain in DOMAINS if is_there(work, domain)}
    everything = pd.concat([comparison(domain, variants) for domain, variants in found.items()], ignore_index=True)
    with atomic(tables / "predictor_3.csv") as temporary:
        everything.to_csv(temporary, index=False, float_format="%.6g")
    with atomic(results / "figures" / "predictor_3.png") as temporary:
        panels = {DOMAINS[domain]: variants for domain, variants in found.items()}
        temporary.write_bytes(png(predictor_figure(panels, HIGH, NAMES)))
    further = [variant for variant in found["insertion"] if (variant.encoding, variant.skills) in FURTHER]
    replace_rows(tables / "figure_3_7.csv", pd.concat([further_rows(variant, HIGH) for variant in further]))
    replace_rows(tables / "figure_3_10_insertion.csv", pd.concat([further_rows(variant) for variant in further]))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
