"""The experiments of chapter 3: task sets, amounts of pre-training, cost regimes and the planners to compare.

Evaluation tasks come in blocks. A block is a pool of tasks and a pool of pre-training tasks; sets are drawn from the
pool, and a robot pre-trained at level l knows the first l skills of the set's own order of the pre-training pool.
With as many blocks as sets the sets are independent; one block for all sets is cheaper and correlates them.

Axis letters: M pool tasks, Q pre-training tasks, n tasks of a set.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from p2l.artifacts import config_hash
from p2l.contracts.domain import Domain, Tasks
from p2l.errors import ConfigError
from p2l.records import Array, IntArray
from p2l.seeding import generator
from p2l.team.baselines import best_theta
from p2l.team.planners import plan
from p2l.team.problem import Order, Plan, Problem

Predictor = Callable[[Array, Array], Array]
# Method → (planner, order of work). `cba_best` takes its θ from a grid search on sets that are not evaluated.
METHODS: dict[str, tuple[str, Order]] = {
    "adl": ("auto", "fixed"),
    "ad": ("ad", "fixed"),
    "cba": ("cba", "fixed"),
    "cba_best": ("cba", "fixed"),
    "alm": ("alm", "fixed"),
    "adl_any": ("auto", "any"),
}


@dataclass(frozen=True)
class Regime:
    """Costs that all tasks share (thesis, section 3.5), and the levels of pre-training at which they are studied."""

    name: str
    c_rob: float
    c_hum: float
    c_fail: float
    c_demo: float
    levels: tuple[int, ...]


@dataclass(frozen=True)
class Study:
    """What is compared, on how much.

    Attributes:
        regimes: cost regimes.
        sets: number of task sets; with `orders`, one per order.
        set_size: n.
        blocks: number of blocks the sets are spread over.
        pool: M tasks of a block.
        pretrained_pool: Q tasks of a block whose skills can be pre-trained.
        draws: noise draws behind an executed success rate (and as many, different ones, behind the true matrix).
        tuning_sets: sets for the grid search of CBA's threshold, drawn from the tasks of `collect`.
        theta: the threshold of the method `cba`.
        orders: fixed sets as tuples of task names, or empty.
        pretrained_draws: simulated executions of each pre-trained skill on each task before a plan is made; 0: their
            success is predicted, as that of lessons is.
    """

    regimes: tuple[Regime, ...]
    sets: int
    set_size: int
    blocks: int
    pool: int
    pretrained_pool: int
    draws: int
    tuning_sets: int
    theta: float
    orders: tuple[tuple[str, ...], ...] = ()
    pretrained_draws: int = 0

    @property
    def executions(self) -> dict[str, int]:
        """Simulated executions of pre-trained skills before plans are made, in all blocks; empty if there are none."""
        number = self.blocks * self.pretrained_pool * self.pool * self.pretrained_draws
        return {"pretrained_executions": number} if number else {}

    def __post_init__(self) -> None:
        deepest = max((max(regime.levels) for regime in self.regimes), default=0)
        if deepest > self.pretrained_pool:
            raise ConfigError(f"study: level {deepest} exceeds the pretrained_pool of {self.pretrained_pool}")
        if self.orders and self.blocks != 1:
            raise ConfigError(f"study: blocks is {self.blocks}; fixed orders need 1")
        if self.set_size > self.pool:
            raise ConfigError(f"study: set_size {self.set_size} exceeds the pool of {self.pool} tasks")
        if not 1 <= self.blocks <= max(self.sets, len(self.orders)):
            raise ConfigError(f"study: blocks is {self.blocks}; allowed are 1 to the number of sets ({self.sets})")


@dataclass(frozen=True)
class Block:
    """Tasks of one block: `pool` (M) and `pretrained` (Q)."""

    index: int
    pool: Tasks
    pretrained: Tasks

    @property
    def digest(self) -> str:
        """Hash of the tasks themselves: plans and their evaluation must speak of the same ones."""
        parts = [[tasks.names, tasks.features.tolist()] for tasks in (self.pool, self.pretrained)]
        return config_hash([self.index, parts])


@dataclass(frozen=True)
class TaskSet:
    """One planning problem: pool indices [n] in work order, pre-training indices [Q] in order of training."""

    index: int
    tasks: IntArray
    pretrained: IntArray


def make_block(domain: Domain, study: Study, seed: int, index: int) -> Block:
    """The tasks of block `index`; they share no random number with those of `collect`."""
    pool = domain.sample_set(generator(seed, "evaluate", domain.name, "pool", index), study.pool)
    rng = generator(seed, "evaluate", domain.name, "pretrained", index)
    return Block(index, pool, domain.sample_tasks(rng, max(1, study.pretrained_pool)))


def task_sets(study: Study, seed: int, block: Block) -> list[TaskSet]:
    """The sets that belong to a block.

    Raises:
        ConfigError: an order names a task that the pool does not have.
    """
    if study.orders:
        index_of = {name: index for index, name in enumerate(block.pool.names)}
        if missing := sorted({name for order in study.orders for name in order} - set(index_of)):
            raise ConfigError(f"study: orders name unknown tasks {missing}; the pool has {', '.join(index_of)}")
        members = [np.array([index_of[name] for name in order]) for order in study.orders]
        indices = range(len(members))
    else:
        indices = range(block.index, study.sets, study.blocks)
        members = [
            generator(seed, "evaluate", "set", index).permutation(len(block.pool))[: study.set_size]
            for index in indices
        ]
    size = len(block.pretrained)
    return [
        TaskSet(index, tasks, generator(seed, "evaluate", "training", index).permutation(size))
        for index, tasks in zip(indices, members, strict=True)
    ]


def make_problem(
    regime: Regime, tasks: Tasks, transfer: Array, pretrained: Array, order: Order = "fixed"
) -> tuple[Problem, IntArray]:
    """A planning problem and the pre-trained skill [n] that each task would use (-1 without any).

    Args:
        regime: costs.
        tasks: n tasks in work order.
        transfer: [n, n] success of the skill of one task (row) on another.
        pretrained: [l, n] success of the l pre-trained skills.
        order: fixed or any.
    """
    n = len(tasks)
    best = pretrained.max(axis=0) if len(pretrained) else np.zeros(n)
    skill = pretrained.argmax(axis=0) if len(pretrained) else np.full(n, -1)
    costs = {name: np.full(n, getattr(regime, name)) for name in ("c_rob", "c_hum", "c_fail", "c_demo")}
    names = tuple(f"{step}:{name}" for step, name in enumerate(tasks.names))
    return Problem(tasks=names, pretrained=best, transfer=transfer, order=order, **costs), skill


def solve(problem: Problem, method: str, theta: float, time_limit_s: float) -> Plan:
    """Plan with one of `METHODS`."""
    planner, _ = METHODS[method]
    options = {"theta": theta} if planner == "cba" else {}
    return plan(problem, planner, time_limit_s=time_limit_s, **options)


def tune_theta(study: Study, regime: Regime, tasks: Tasks, predict: Predictor, seed: int) -> float:
    """CBA's best threshold by predicted cost on sets drawn from the tasks of `collect`, not from the evaluated sets."""
    problems = []
    for index in range(study.tuning_sets):
        rng = generator(seed, "tune", "theta", index)
        rows = rng.permutation(len(tasks))
        members = tasks.take(rows[: study.set_size])
        level = regime.levels[index % len(regime.levels)]
        others = tasks.take(rows[study.set_size : study.set_size + level]) if level else None
        pretrained = predict(others.features, members.features) if others is not None else np.zeros((0, len(members)))
        problems.append(make_problem(regime, members, predict(members.features, members.features), pretrained)[0])
    return best_theta(problems)[0]


def cases(study: Study, sets: Sequence[TaskSet]) -> Iterator[tuple[TaskSet, Regime, int]]:
    """Every (set, regime, level) of a block."""
    for task_set in sets:
        for regime in study.regimes:
            for level in regime.levels:
                yield task_set, regime, level
