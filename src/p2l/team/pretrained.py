"""What the robot can do today, measured: its pre-trained skills tried in simulation on the tasks of a day.

The lesson predictor answers for skills that do not exist yet. Skills that the robot has can be run before a plan is
made (ρ_0 of the thesis's eq. 3.2), which takes `pretrained_draws` simulated executions of each skill on each task. They
meet errors of the estimate of their own: neither those that execute the plans nor those of the true matrix.

Axis letters: M pool tasks, Q pre-training tasks, P skill parameters.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from p2l.artifacts import config_hash
from p2l.contracts.domain import Domain, Progress
from p2l.ledger import Item, find
from p2l.records import Array, freeze
from p2l.seeding import generator
from p2l.team.items import recorded
from p2l.team.study import Block, Study

# Part of every record's hash: raise it when simulator, world or learner give other outcomes than before.
PRETRAINED_VERSION = 1


def learn_block(domain: Domain, seed: int, block: Block, progress: Progress | None = None) -> Array:
    """[M + Q, P] the skills of all tasks of a block, pool first; NaN where lengths differ."""
    tasks = block.pool.join(block.pretrained)
    rng = generator(seed, "evaluate", domain.name, "learn", block.index)
    return domain.learn(tasks, np.arange(len(tasks)), rng, progress)


def measure_pretrained(
    domain: Domain, study: Study, seed: int, block: Block, skills: Array, progress: Progress | None = None
) -> Array:
    """[Q, M] success rates of the pre-trained ones of a block's skills [M + Q, P] on its pool."""
    rng = generator(seed, "plan", domain.name, "pretrained", block.index)
    own = skills[len(block.pool) :]
    outcome = domain.evaluate(own, block.pretrained, block.pool, study.pretrained_draws, rng, progress)
    return np.asarray(outcome.mean(-1))


def recorded_pretrained(
    domain: Domain,
    study: Study,
    seed: int,
    block: Block,
    records: Path,
    identity: str,
    progress: Progress | None = None,
) -> Array:
    """[Q, M] `measure_pretrained` from its record in the ledger, else by simulation, which leaves a record.

    The skills are kept as well, so that the truth of the block is that of the very skills that were measured.

    Args:
        domain: the world.
        study: the experiment.
        seed: of the evaluation.
        block: its tasks.
        records: folder of the ledger.
        identity: hash of what decides the skills besides the tasks.
        progress: called while simulating.
    """
    decisive = [PRETRAINED_VERSION, identity, block.digest, study.pretrained_draws]
    item = Item(domain.name, "pretrained", seed, block.index, config_hash(decisive))
    if (record := find(records, item)) is None:
        skills = _kept_skills(
            domain, seed, block, records, identity, progress
        )  # which has a record and time of its own

        def measured() -> dict[str, Any]:
            rate = measure_pretrained(domain, study, seed, block, skills, progress)
            return {"rate": rate.tolist(), "executions": rate.size * study.pretrained_draws}

        record = recorded(records, item, measured)
    sizes = {"Q": len(block.pretrained), "M": len(block.pool)}
    return freeze("pretrained", record["rate"], ("Q", "M"), sizes, low=0.0, high=1.0)


def measurement(domain: Domain, study: Study, seed: int, records: Path, identity: str) -> Callable[[Block], Array]:
    """`recorded_pretrained` as a function of the block alone."""
    return lambda block: recorded_pretrained(domain, study, seed, block, records, identity)


def recorded_skills(domain: Domain, seed: int, block: Block, records: Path, identity: str) -> Array | None:
    """[M + Q, P] the skills of a block if its record holds them, see `learn_block`."""
    record = find(records, _skills_item(domain, seed, block, identity))
    return None if record is None else _skills(record, block)


def _kept_skills(
    domain: Domain, seed: int, block: Block, records: Path, identity: str, progress: Progress | None
) -> Array:
    """[M + Q, P] the skills of a block from their record, else learnt, which leaves one."""

    def learnt() -> dict[str, Any]:
        skills = learn_block(domain, seed, block, progress)
        return {"skills": [[None if np.isnan(value) else value for value in row] for row in skills.tolist()]}

    return _skills(recorded(records, _skills_item(domain, seed, block, identity), learnt), block)


def _skills(record: dict[str, Any], block: Block) -> Array:
    sizes = {"S": len(block.pool) + len(block.pretrained)}
    return freeze("skills", np.array(record["skills"], dtype=np.float64), ("S", "P"), sizes, finite=False)


def _skills_item(domain: Domain, seed: int, block: Block, identity: str) -> Item:
    return Item(domain.name, "skills", seed, block.index, config_hash([PRETRAINED_VERSION, identity, block.digest]))
