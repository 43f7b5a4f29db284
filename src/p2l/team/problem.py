"""What the team planner is given and what it answers (thesis, section 3.2.1).

Axis letters of this room: n tasks, D demands, F facilities, Z useful pairs. Costs share one unit, chosen by the user.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, cast

import numpy as np

from p2l.errors import ShapeError
from p2l.records import Array, BoolArray, IntArray, freeze

Order = Literal["fixed", "any"]
Status = Literal["optimal", "feasible", "time_limit", "heuristic"]
ORDERS: tuple[str, ...] = ("fixed", "any")


class Decision(IntEnum):
    """What happens to one task: the robot acts, the person does it, or the person teaches it (equation 3.1).

    Example:
        >>> from p2l import Decision
        >>> Decision(2).name
        'LEARN'
    """

    ACT = 0
    DELEGATE = 1
    LEARN = 2


@dataclass(frozen=True)
class Problem:
    """An Act, Delegate or Learn instance: tasks in work order, their costs, and which lesson helps on which task.

    Attributes:
        tasks: n distinct task names, in work order.
        c_rob: [n] cost of a robot attempt.
        c_hum: [n] cost of handing the task to the person.
        c_fail: [n] cost of a failed attempt, paid on top of the attempt.
        c_demo: [n] cost of a demonstration, which also completes the task.
        pretrained: [n] success probability ρ_0 of the skills that the robot already has.
        transfer: [n, n] success probability on the tested task (column) after a lesson on the taught task (row).
            The diagonal is not used: a taught task is completed by its own demonstration.
        order: "fixed" (only earlier lessons help) or "any" (the planner may put every lesson first, section 6.2.1).

    Raises:
        ShapeError: a wrong shape, NaN or infinity, a negative cost, a probability outside [0, 1], a repeated name.

    Example:
        Two tasks that the robot cannot do yet; a lesson on one carries over to the other nine times in ten.

        >>> import numpy as np
        >>> from p2l import Problem
        >>> costs = {name: np.full(2, cost) for name, cost in (("c_rob", 10.0), ("c_hum", 100.0), ("c_fail", 100.0))}
        >>> problem = Problem(
        ...     tasks=("peg", "hole"), **costs, c_demo=np.full(2, 120.0), pretrained=np.zeros(2),
        ...     transfer=np.array([[1.0, 0.9], [0.9, 1.0]]),
        ... )
        >>> problem.n, problem.outside.tolist()
        (2, [100.0, 100.0])
    """

    tasks: tuple[str, ...]
    c_rob: Array
    c_hum: Array
    c_fail: Array
    c_demo: Array
    pretrained: Array
    transfer: Array
    order: Order = "fixed"

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "tasks", tuple(str(name) for name in self.tasks))
        if not self.tasks:
            raise ShapeError("tasks: none given; a problem needs at least one task")
        if len(set(self.tasks)) < len(self.tasks):
            twice = next(name for name in self.tasks if self.tasks.count(name) > 1)
            raise ShapeError(f"tasks: '{twice}' appears more than once; give every task its own name")
        if self.order not in ORDERS:
            raise ShapeError(f"order: '{self.order}' is unknown; use one of {list(ORDERS)}")
        sizes = {"n": self.n}
        for name in ("c_rob", "c_hum", "c_fail", "c_demo"):
            put(self, name, freeze(name, getattr(self, name), ("n",), sizes, low=0.0))
        put(self, "pretrained", freeze("pretrained", self.pretrained, ("n",), sizes, low=0.0, high=1.0))
        put(self, "transfer", freeze("transfer", self.transfer, ("n", "n"), sizes, low=0.0, high=1.0))
        with np.errstate(over="ignore"):
            total = float(np.sum([self.c_rob, self.c_hum, self.c_fail, self.c_demo]))
        if not math.isfinite(total):
            raise ShapeError("costs: their sum overflows; express them in a larger unit")

    @property
    def n(self) -> int:
        """How many tasks there are."""
        return len(self.tasks)

    @property
    def attempt(self) -> Array:
        """[n] expected cost of an attempt with the pre-trained skills."""
        return cast(Array, self.c_rob + (1.0 - self.pretrained) * self.c_fail)

    @property
    def outside(self) -> Array:
        """[n] b_i = min(c_hum, c_rob + (1 - ρ_0) c_fail): the cheapest way to do a task without any lesson."""
        return np.minimum(self.c_hum, self.attempt)

    def service_cost(self, lessons: int | slice | IntArray) -> Array:
        """Expected cost of attempting every task with the skill of one lesson ([n]) or of several ([L, n])."""
        return cast(Array, self.c_rob + (1.0 - self.transfer[lessons]) * self.c_fail)


@dataclass(frozen=True)
class Certificate:
    """Why a lower bound holds: multipliers v of the assignment constraints and the bound L(v) that follows from them.

    L(v) = Σ_i v_i + Σ_j min(0, f_j - Σ_i (v_i - c_ij)⁺) with v_i ≤ b_i (`p2l.team.certificate` recomputes it).

    Attributes:
        multipliers: [D] v, one per task or demand.
        bound: L(v).
        cost: cost of the plan that travels with it.
    """

    multipliers: Array
    bound: float
    cost: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "multipliers", freeze("multipliers", self.multipliers, ("D",), {}))


@dataclass(frozen=True)
class Plan:
    """A decision for every task, its expected cost, and a bound on what any plan must cost.

    Attributes:
        planner: name of the route that made it.
        status: "optimal" (proven), "feasible" (stopped inside the requested gap), "time_limit" or "heuristic".
        sequence: [n] task indices in the order of work.
        decision: [n] a `Decision` per task.
        skill: [n] task whose lesson an attempt uses; the task itself when taught; -1 for pre-trained or none.
        p_success: [n] success probability (1 when delegated or taught).
        expected_cost: [n] expected cost of each task.
        objective: their sum.
        lower_bound: proven: no plan of this problem costs less.
        gap: (objective - lower_bound) / objective, 0 when the objective is 0.
        seconds: wall time of the planner, without loading (and on a fresh installation compiling) its kernels.
        certificate: multipliers that prove `certificate.bound`, where the route has them.

    Example:
        >>> import numpy as np
        >>> from p2l import Decision, Plan, Problem, plan
        >>> one = np.ones(1)
        >>> day: Plan = plan(Problem(("gear",), 10 * one, 100 * one, 100 * one, 200 * one, 0.95 * one, np.eye(1)))
        >>> day.status, round(day.objective, 1), day.count(Decision.ACT)
        ('optimal', 15.0, 1)
    """

    planner: str
    status: Status
    sequence: IntArray
    decision: IntArray
    skill: IntArray
    p_success: Array
    expected_cost: Array
    objective: float
    lower_bound: float
    gap: float
    seconds: float
    certificate: Certificate | None = None

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        put = object.__setattr__
        for name in ("sequence", "decision", "skill"):
            put(self, name, freeze(name, getattr(self, name), ("n",), sizes, np.int64))
        for name in ("p_success", "expected_cost"):
            put(self, name, freeze(name, getattr(self, name), ("n",), sizes))

    def count(self, decision: Decision) -> int:
        """How many tasks get this decision."""
        return int((self.decision == decision).sum())


@dataclass(frozen=True)
class FacilitySolution:
    """Which facilities to open and which of them serves each demand (thesis, equation 3.3).

    Attributes:
        open: [F] True where a facility is opened.
        assignment: [D] index of the open facility that serves each demand.
        cost: opening plus service cost, recomputed from the input.
        lower_bound: proven.
        status: as in `Plan`.
        seconds: wall time, without loading the kernels.
        certificate: multipliers that prove `certificate.bound`.
    """

    open: BoolArray
    assignment: IntArray
    cost: float
    lower_bound: float
    status: Status
    seconds: float
    certificate: Certificate | None = None

    @property
    def gap(self) -> float:
        """(cost - lower_bound) / cost."""
        return relative_gap(self.cost, self.lower_bound)


def relative_gap(cost: float, lower_bound: float) -> float:
    """(cost - lower_bound) / cost, at least 0; 0 when nothing costs anything."""
    return max(0.0, (cost - lower_bound) / cost) if cost > 0.0 else 0.0
