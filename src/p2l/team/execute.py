"""Plans run in the world: what they really cost (thesis, section 3.5, "Evaluation metrics").

A robot attempt succeeds or fails by simulation and a failure costs c_fail; a demonstration and a person always
succeed. The success rates of all skills on all tasks of a block are simulated once (the truth) and serve every plan,
so all methods meet the same estimate errors. Half of the draws give the true matrix that `adl_true` plans with, the
other half execute, so no plan is judged by the draws it was made from.

Axis letters: M pool tasks, Q pre-training tasks, n tasks of a set.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from p2l.artifacts import config_hash
from p2l.contracts.domain import Domain, Progress, Tasks
from p2l.ledger import Item
from p2l.records import Array, IntArray, TransferData, freeze
from p2l.seeding import generator
from p2l.team.items import recorded
from p2l.team.pretrained import learn_block, recorded_skills
from p2l.team.problem import Decision, Plan
from p2l.team.study import (
    METHODS,
    Block,
    Predictor,
    Regime,
    Study,
    TaskSet,
    cases,
    make_block,
    make_problem,
    solve,
    task_sets,
    tune_theta,
)

# Part of every truth record's hash: raise it when simulator, world or learner give other outcomes than before.
TRUTH_VERSION = 1
PREDICTIONS = ("p_success", "predicted_cost")  # columns of plans


@dataclass(frozen=True)
class Truth:
    """Simulated success rates of the M + Q skills of a block (rows: pool first) on its M tasks.

    Attributes:
        planning: [M + Q, M] from the draws that `adl_true` may see.
        executing: [M + Q, M] from the draws that judge every plan.
    """

    planning: Array
    executing: Array

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        for name in ("planning", "executing"):
            value = freeze(name, getattr(self, name), ("S", "M"), sizes, low=0.0, high=1.0)
            object.__setattr__(self, name, value)


def measure_truth(
    domain: Domain,
    study: Study,
    seed: int,
    block: Block,
    progress: Progress | None = None,
    skills: Array | None = None,
) -> Truth:
    """Teach the robot every task of a block, unless `skills` [M + Q, P] are given, and try all on every pool task."""
    tasks = block.pool.join(block.pretrained)
    if skills is None:
        skills = learn_block(domain, seed, block, progress)
    rng = generator(seed, "evaluate", domain.name, "draws", block.index)
    outcome = domain.evaluate(skills, tasks, block.pool, 2 * study.draws, rng, progress)
    return Truth(outcome[..., : study.draws].mean(-1), outcome[..., study.draws :].mean(-1))


def study_plans(
    domain: Domain,
    study: Study,
    seed: int,
    collected: TransferData,
    predict: Predictor,
    limit_s: float,
    measure: Callable[[Block], Array] | None = None,
) -> tuple[dict[str, float], pd.DataFrame]:
    """CBA's best threshold by regime, and plans of every method for every case of all blocks.

    Args:
        domain: of the tasks.
        study: what is compared.
        seed: of the experiment.
        collected: tasks that thresholds are tuned on.
        predict: success from features of the taught and the tested tasks.
        limit_s: wall seconds of each planner.
        measure: success [Q, M] of a block's pre-trained skills on its pool; None: it is predicted.
    """
    pool = Tasks(collected.names, collected.features, collected.group)
    thetas = {regime.name: tune_theta(study, regime, pool, predict, seed) for regime in study.regimes}
    blocks = [make_block(domain, study, seed, index) for index in range(study.blocks)]
    frames = []
    for block in blocks:
        library = None if measure is None else measure(block)
        frames.append(predicted_plans(study, seed, block, predict, thetas, limit_s, library))
    return thetas, pd.concat(frames)


def predicted_plans(
    study: Study,
    seed: int,
    block: Block,
    predict: Predictor,
    thetas: dict[str, float],
    limit_s: float,
    library: Array | None = None,
) -> pd.DataFrame:
    """Plans of every method for every case of a block, one row per task (see `plan_rows`).

    `library` [Q, M] is the measured success of pre-trained skills; without it theirs is predicted as lessons' is.
    """
    pool = predict(block.pool.features, block.pool.features)
    if library is None:
        library = predict(block.pretrained.features, block.pool.features)
    frames = []
    for task_set, regime, level in cases(study, task_sets(study, seed, block)):
        for method, (_, order) in METHODS.items():
            theta = thetas[regime.name] if method == "cba_best" else study.theta
            library_rows = task_set.pretrained[:level]
            problem, skill = make_problem(
                regime,
                block.pool.take(task_set.tasks),
                pool[np.ix_(task_set.tasks, task_set.tasks)],
                library[np.ix_(library_rows, task_set.tasks)],
                order,
            )
            plan = solve(problem, method, theta, limit_s)
            frames.append(plan_rows(block, task_set, regime, level, method, plan, skill))
    return pd.concat(frames, ignore_index=True)


def true_plans(study: Study, seed: int, block: Block, truth: Truth, limit_s: float) -> pd.DataFrame:
    """Plans of `adl_true`: the exact planner given the simulated transfer matrix."""
    size = len(block.pool)
    frames = []
    for task_set, regime, level in cases(study, task_sets(study, seed, block)):
        library_rows = size + task_set.pretrained[:level]
        problem, skill = make_problem(
            regime,
            block.pool.take(task_set.tasks),
            truth.planning[np.ix_(task_set.tasks, task_set.tasks)],
            truth.planning[np.ix_(library_rows, task_set.tasks)],
        )
        plan = solve(problem, "adl", 0.0, limit_s)
        frames.append(plan_rows(block, task_set, regime, level, "adl_true", plan, skill))
    return pd.concat(frames, ignore_index=True)


def plan_rows(
    block: Block, task_set: TaskSet, regime: Regime, level: int, method: str, plan: Plan, pretrained: IntArray
) -> pd.DataFrame:
    """One row per task in the order of work; `skill` is a row of `Truth` (-1 where no robot skill is used)."""
    steps = plan.sequence
    lesson = np.where(plan.skill >= 0, task_set.tasks[np.maximum(plan.skill, 0)], -1)
    library_skill = np.where(pretrained >= 0, len(block.pool) + task_set.pretrained[np.maximum(pretrained, 0)], -1)
    acts = plan.decision == Decision.ACT
    skill = np.where(acts & (plan.skill < 0), library_skill, np.where(plan.decision == Decision.DELEGATE, -1, lesson))
    return pd.DataFrame(
        {
            "block": block.index,
            "digest": block.digest,
            "set": task_set.index,
            "regime": regime.name,
            "level": level,
            "method": method,
            "step": np.arange(len(steps)),
            "task": task_set.tasks[steps],
            "name": [block.pool.names[index] for index in task_set.tasks[steps]],
            "decision": [Decision(code).name.lower() for code in plan.decision[steps]],
            "skill": skill[steps],
            "p_success": plan.p_success[steps],
            "predicted_cost": plan.expected_cost[steps],
        }
    )


def execute_plans(plans: pd.DataFrame, regimes: tuple[Regime, ...], truth: Truth) -> pd.DataFrame:
    """Execute the plans of a block; one row per (set, regime, level, method) with predicted and executed cost.

    `failures` is the expected number of failed attempts over the executing draws.
    """
    costs = pd.DataFrame([regime.__dict__ for regime in regimes]).drop(columns="levels")
    rows = plans.merge(costs, left_on="regime", right_on="name", suffixes=("", "_regime"))
    skill, task = rows["skill"].to_numpy(), rows["task"].to_numpy()
    acts = (rows["decision"] == "act").to_numpy()
    success = np.where(skill >= 0, truth.executing[np.maximum(skill, 0), task], 0.0)
    failure = np.where(acts, 1.0 - success, 0.0)
    cost = np.select(
        [rows["decision"] == "learn", rows["decision"] == "delegate"],
        [rows["c_demo"], rows["c_hum"]],
        rows["c_rob"] + failure * rows["c_fail"],
    )
    rows = rows.assign(
        executed_cost=cost,
        failures=failure,
        attempts=acts.astype(float),
        demos=(rows["decision"] == "learn").astype(float),
        delegated=(rows["decision"] == "delegate").astype(float),
        n_tasks=1.0,
    )
    keys = ["block", "set", "regime", "level", "method"]
    sums = ["predicted_cost", "executed_cost", "demos", "delegated", "attempts", "failures", "n_tasks"]
    return rows.groupby(keys, sort=True)[sums].sum().reset_index()


def recorded_truth(
    domain: Domain,
    study: Study,
    seed: int,
    block: Block,
    records: Path,
    identity: str,
    progress: Progress | None = None,
) -> Truth:
    """The truth of a block from its record in the ledger, else by simulation, which leaves a record.

    Args:
        domain: the world.
        study: the experiment.
        seed: of the evaluation.
        block: its tasks.
        records: folder of the ledger.
        identity: hash of what decides the truth besides the tasks.
        progress: called while simulating.
    """
    item = Item(domain.name, "truth", seed, block.index, config_hash([TRUTH_VERSION, identity, block.digest]))

    def measured() -> dict[str, Any]:
        skills = recorded_skills(domain, seed, block, records, identity)
        truth = measure_truth(domain, study, seed, block, progress, skills)
        return {"planning": truth.planning.tolist(), "executing": truth.executing.tolist()}

    record = recorded(records, item, measured)
    return Truth(record["planning"], record["executing"])


def recorded_rows(
    domain: Domain, study: Study, seed: int, plans: pd.DataFrame, truth: Truth, records: Path
) -> list[dict[str, Any]]:
    """Executed rows of one method in one block, from its record if the same plans met the same truth.

    Plans are known by who does what: predictions differ in their last bits from one processor to another.
    """
    method, block = str(plans["method"].iloc[0]), int(plans["block"].iloc[0])
    regimes = [regime.__dict__ for regime in study.regimes]
    decisive = [regimes, plans.drop(columns=list(PREDICTIONS)).to_dict("records"), truth.executing.tolist()]
    item = Item(domain.name, method, seed, block, config_hash(decisive))
    record = recorded(records, item, lambda: {"rows": execute_plans(plans, study.regimes, truth).to_dict("records")})
    rows: list[dict[str, Any]] = record["rows"]
    return rows
