"""Planning anew as the day goes against planning once, at thesis scale: replanning_3.csv, by one command.

    python scripts/replanning.py results/thesis [a working folder, build/replanning if none is given]

Days are those of predictor_3.csv and prediction_price.csv: the same sets, predictors and truths, from the records.
What days have come to is kept there as <domain>-replanning_<encoding>_<skills>-…: with these records the table is made
in seconds, without them in minutes. Draws: generator(seed, "replanning", domain, "draws", set), WALKS rows of a uniform
number per task, the same for all ways and cases of a set.

    python scripts/replanning.py results/thesis --setting

prints the log likelihood of `prior_n` and `spread` on the tasks of `collect` with seeds 101 and 102 under the predictor
of seed 0 (insertion, walls), from which the defaults of `p2l.team.day.SkillPrior` are.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from hydra import compose, initialize_config_dir

from p2l.artifacts import atomic, config_hash, load_arrays
from p2l.contracts.domain import Domain
from p2l.domains.table import make_domain
from p2l.evaluation.team.replanning import TRUTH, ReplanningVariant, replanning_table
from p2l.ledger import Item, find, write
from p2l.records import Array, IntArray, TransferData
from p2l.schema import PlanConfig, resolve, validate
from p2l.seeding import generator
from p2l.team.day.simulation import WAYS, Result, simulate, truths_of
from p2l.team.day.skills import SkillPrior, log_likelihood
from p2l.team.execute import Truth, recorded_truth
from p2l.team.pretrained import recorded_pretrained
from p2l.team.problem import Problem
from p2l.team.shop import Shop
from p2l.team.shop.files import of_plan
from p2l.team.study import Block, Study, TaskSet, cases, make_block, make_problem, solve, task_sets
from p2l.transfer.model import TransferModel, load_transfer_model

ROOT = Path(__file__).resolve().parents[1]
VERSION, WALKS, LIMIT_S = 1, 8, 60.0
SETTING = SkillPrior()
# domain, encoding, what is known of pre-trained skills in the morning, levels of pre-training at most. Lego has no
# measurement of its own: there it is what the true plan sees of them. The thesis's encoding is a reference, at level 0.
VARIANTS = (
    ("insertion", "walls", "measured", 10),
    ("insertion", "difference", "predicted", 0),
    ("lego", "concatenation", "predicted", 8),
    ("lego", "concatenation", "measured", 8),
    ("board", "difference", "predicted", 0),
)


def config_of(domain: str, encoding: str, skills: str) -> PlanConfig:
    """The study of a variant at thesis scale."""
    words = ["experiment=thesis", f"domain={domain}", "tracking=disabled"]
    if domain == "insertion":
        words += [
            f"++domain.params.encoding={encoding}",
            f"study=insertion{'_measured' if skills == 'measured' else ''}",
        ]
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        return validate(resolve(compose("plan", overrides=words)), PlanConfig, "configuration")


def model_of(work: Path, records: Path, domain: str, encoding: str, world: Domain) -> TransferModel:
    """The predictor of a domain, as the stages `collect` and `fit_transfer` make it or take it from the records."""
    words = ["experiment=thesis", "tracking=disabled", f"domain={domain}", f"records={records}"]
    collected, fitted = work / "collect" / domain, work / "fit_transfer" / f"{domain}-{encoding}"
    if not (fitted / "transfer_model.safetensors.json").is_file():
        run("collect", *words, f"hydra.run.dir={collected}")
        more = [f"++domain.params.encoding={encoding}"] if domain == "insertion" else []
        data = f"transfer_data={collected / 'transfer_data.npz'}"
        run("fit_transfer", *words, *more, data, f"hydra.run.dir={fitted}")
    path = fitted / "transfer_model.safetensors"
    return load_transfer_model(path, feature_names=world.feature_names, encoding=world.encoding)


def run(stage: str, *words: str) -> None:
    """Run a stage."""
    subprocess.run([sys.executable, "-m", f"stages.{stage}", *words], cwd=ROOT, check=True)


def variant_of(work: Path, records: Path, domain: str, encoding: str, skills: str, most: int) -> ReplanningVariant:
    """What days come to, from the record if the same days were walked through before."""
    config = config_of(domain, encoding, skills)
    world, study = make_domain(config.domain.key, config.domain.params), config.study.study()
    blocks = [make_block(world, study, config.seed, index) for index in range(study.blocks)]
    digests = [block.digest for block in blocks]
    regimes = [regime.__dict__ for regime in study.regimes]
    setting = [SETTING.prior_n, SETTING.spread]
    decisive = [
        VERSION,
        config.identity,
        digests,
        regimes,
        study.pretrained_draws,
        encoding,
        skills,
        most,
        WALKS,
        setting,
    ]
    item = Item(domain, f"replanning_{encoding}_{skills}", config.seed, 0, config_hash(decisive))
    if (record := find(records, item)) is None:
        start = time.perf_counter()
        model = model_of(work, records, domain, encoding, world)
        rows: list[dict[str, Any]] = []
        for block in blocks:
            truth = recorded_truth(world, study, config.seed, block, records, config.identity)
            library = library_of(world, study, config, block, truth, records, model, skills)
            rows += block_rows(study, config.seed, domain, block, truth, model, library, most)
            sys.stderr.write(f"{item.file}: block {block.index + 1} of {study.blocks}\n")
        record = {"rows": rows}
        write(records, item, record, seconds=time.perf_counter() - start)
    return ReplanningVariant(domain, encoding, skills, pd.DataFrame(record["rows"]))


def library_of(
    world: Domain,
    study: Study,
    config: PlanConfig,
    block: Block,
    truth: Truth,
    records: Path,
    model: TransferModel,
    skills: str,
) -> Array:
    """[Q, M] what is known in the morning of a block's pre-trained skills."""
    if skills == "predicted":
        return model.predict(block.pretrained.features, block.pool.features)
    if study.pretrained_draws:
        return recorded_pretrained(world, study, config.seed, block, records, config.identity)
    return truth.planning[len(block.pool) :]


def block_rows(
    study: Study, seed: int, domain: str, block: Block, truth: Truth, model: TransferModel, library: Array, most: int
) -> Iterator[dict[str, Any]]:
    """Rows of every case of a block and way through it."""
    predicted = model.predict(block.pool.features, block.pool.features)
    size = len(block.pool)
    for task_set, regime, level in cases(study, task_sets(study, seed, block)):
        if level > most:
            continue
        tasks, known = task_set.tasks, task_set.pretrained[:level]
        members, square = block.pool.take(tasks), np.ix_(tasks, tasks)
        uniforms = generator(seed, "replanning", domain, "draws", task_set.index).random((WALKS, len(tasks)))
        about = {"set": task_set.index, "regime": regime.name, "level": level}
        problem, skill = make_problem(regime, members, predicted[square], library[np.ix_(known, tasks)])
        plan = of_plan(solve(problem, "adl", 0.0, LIMIT_S))
        truths = truths_of(truth.planning, truth.executing, tasks, row_of(task_set, skill, size), study.draws)
        for way in WAYS:
            results = simulate(Shop.of_problem(problem), plan, truths, uniforms, way, SETTING, LIMIT_S)
            yield {**about, "way": way, **means(results)}
        yield {**about, "way": TRUTH, **true_means(study, block, truth, task_set, regime, known)}


def true_means(
    study: Study, block: Block, truth: Truth, task_set: TaskSet, regime: Any, known: IntArray
) -> dict[str, float]:
    """What the plan from the true transfer comes to."""
    tasks, size = task_set.tasks, len(block.pool)
    library = truth.planning[np.ix_(size + known, tasks)]
    problem: Problem
    problem, skill = make_problem(regime, block.pool.take(tasks), truth.planning[np.ix_(tasks, tasks)], library)
    truths = truths_of(truth.planning, truth.executing, tasks, row_of(task_set, skill, size), study.draws)
    plan = of_plan(solve(problem, "adl", 0.0, LIMIT_S))
    return means(simulate(Shop.of_problem(problem), plan, truths, np.zeros((1, len(tasks))), "once", SETTING))


def row_of(task_set: TaskSet, skill: IntArray, size: int) -> IntArray:
    """[n] row of the pre-trained skill of each task in the block's truth, -1 for none."""
    return np.where(skill >= 0, size + task_set.pretrained[np.maximum(skill, 0)], -1)


def means(results: list[Result]) -> dict[str, float]:
    """Means over the walks."""
    return {
        "cost": float(np.mean([each.cost for each in results])),
        "demos": float(np.mean([each.lessons for each in results])),
        "delegated": float(np.mean([each.delegated for each in results])),
        "failures": float(np.mean([each.failures for each in results])),
    }


def print_setting(work: Path, records: Path) -> None:
    """Log likelihood of the outcomes of other seeds' lessons, each pair of them tried `draws` times."""
    config = config_of("insertion", "walls", "measured")
    world = make_domain(config.domain.key, config.domain.params)
    model = model_of(work, records, "insertion", "walls", world)
    lessons = []
    for seed in (101, 102):
        folder = work / "collect" / f"insertion-s{seed}"
        words = ("experiment=thesis", "tracking=disabled", "domain=insertion", f"records={records}", f"seed={seed}")
        run("collect", *words, f"hydra.run.dir={folder}")
        arrays = load_arrays(folder / "transfer_data.npz", schema="transfer_data", version=1)
        data = TransferData.from_arrays(arrays)
        predicted = model.predict(data.features[data.train_task], data.features)
        for row, taught in enumerate(data.train_task.tolist()):
            others = np.arange(len(data.names)) != taught
            won = data.successes[row][others].astype(float)
            lessons.append((predicted[row][others], won, data.draws - won))
    sys.stdout.write("prior_n spread log_likelihood\n")
    for prior_n in (0.3, 0.5, 1.0, 2.0, 4.0):
        for spread in (0.0, 0.25, 0.5, 0.75, 1.0, 1.5):
            total = sum(log_likelihood(*lesson, SkillPrior(prior_n, spread)) for lesson in lessons)
            sys.stdout.write(f"{prior_n:g} {spread:g} {total:.1f}\n")


def main(results: Path, work: Path, *, setting: bool) -> None:
    """Read and complete the records, write the table."""
    records = results.resolve() / "records"
    if setting:
        print_setting(work, records)
        return
    table = replanning_table(
        [variant_of(work, records, *variant) for variant in VARIANTS], generator(0, "replanning", "intervals")
    )
    with atomic(results / "tables" / "replanning_3.csv") as temporary:
        table.to_csv(temporary, index=False, float_format="%.6g")


if __name__ == "__main__":
    places = [Path(word) for word in sys.argv[1:] if not word.startswith("--")]
    folder = places[1] if len(places) > 1 else ROOT / "build" / "replanning"
    main(places[0], folder.resolve(), setting="--setting" in sys.argv)
