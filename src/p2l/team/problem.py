"""What the team planner is given and what it answers (thesis, section 3.2.1).

Axis letters of this room: n tasks, D demands, F facilities, Z useful pairs. Costs share one unit, chosen by the user.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Literal, cast

import numpy as np

from p2l.errors import ShapeError
from p2l.records import Array, BoolArray, IntArray, freeze
from p2l.team.costs import freeze_cost

Order = Literal["fixed", "any"]
Status = Literal["optimal", "feasible", "time_limit", "heuristic"]
ORDERS: tuple[str, ...] = ("fixed", "any")
_FAR = 1e120  # no multiplier that proves anything is beyond it, and sums of such do not overflow


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
        c_rob: [n] cost of a robot attempt; infinite: the robot cannot attempt the task.
        c_hum: [n] cost of handing the task to the person; infinite: the person cannot do it.
        c_fail: [n] cost of a failed attempt, paid on top of the attempt; infinite: no attempt that may fail.
        c_demo: [n] cost of a demonstration, which also completes the task; infinite: it cannot be taught.
        pretrained: [n] success probability ρ_0 of the skills that the robot already has.
        transfer: [n, n] success probability on the tested task (column) after a lesson on the taught task (row).
            The diagonal is not used: a taught task is completed by its own demonstration.
        order: "fixed" (only earlier lessons help) or "any" (the planner may put every lesson first, section 6.2.1).

    Raises:
        ShapeError: a wrong shape, NaN, a negative cost, one above 1e100 that is not infinite, a probability outside
            [0, 1], a repeated name, a task that nobody can do.

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
        given: object = self.tasks
        if isinstance(given, (str, bytes, set, frozenset, Mapping)) or not isinstance(given, Iterable):
            raise ShapeError(f"tasks: {given!r} given; expected a list of names, in work order")
        put(self, "tasks", tuple(str(name) for name in self.tasks))
        if bad := [name for name in self.tasks if not name or any("\ud800" <= each <= "\udfff" for each in name)]:
            raise ShapeError(f"tasks: {bad[0]!r} is no name; give every task one that can be written")
        if not self.tasks:
            raise ShapeError("tasks: none given; a problem needs at least one task")
        if len(set(self.tasks)) < len(self.tasks):
            twice = next(name for name in self.tasks if self.tasks.count(name) > 1)
            raise ShapeError(f"tasks: '{twice}' appears more than once; give every task its own name")
        if not isinstance(cast(object, self.order), str) or self.order not in ORDERS:
            raise ShapeError(f"order: '{self.order}' is unknown; use one of {list(ORDERS)}")
        sizes = {"n": self.n}
        for name in ("c_rob", "c_hum", "c_fail", "c_demo"):
            put(self, name, freeze_cost(name, getattr(self, name), ("n",), sizes))
        put(self, "pretrained", freeze("pretrained", self.pretrained, ("n",), sizes, low=0.0, high=1.0))
        put(self, "transfer", freeze("transfer", self.transfer, ("n", "n"), sizes, low=0.0, high=1.0))
        self._refuse_impossible_tasks()

    def _refuse_impossible_tasks(self) -> None:
        """A plan that teaches all that can be taught does every task, unless one of them has no way at all."""
        for task in np.flatnonzero(np.isinf(self.outside) & np.isinf(self.c_demo)).tolist():
            lessons = np.isfinite(self.c_demo)
            if self.order == "fixed":
                lessons[task:] = False
            best = max(self.transfer[lessons, task], default=0.0)
            if not math.isfinite(float(self.attempt_cost(np.array([best]), [task])[0])):
                raise ShapeError(
                    f"task '{self.tasks[task]}' cannot be done: nobody can do or teach it, and no lesson that comes in "
                    "time makes an attempt possible; give it a finite cost"
                )

    @property
    def n(self) -> int:
        """How many tasks there are."""
        return len(self.tasks)

    @property
    def attempt(self) -> Array:
        """[n] expected cost of an attempt with the pre-trained skills."""
        return self.attempt_cost(self.pretrained)

    @property
    def outside(self) -> Array:
        """[n] b_i = min(c_hum, c_rob + (1 - ρ_0) c_fail): the cheapest way to do a task without any lesson."""
        return np.minimum(self.c_hum, self.attempt)

    def service_cost(self, lessons: int | slice | IntArray) -> Array:
        """Expected cost of attempting every task with the skill of one lesson ([n]) or of several ([L, n])."""
        return self.attempt_cost(self.transfer[lessons])

    def attempt_cost(self, probability: Array, tasks: slice | Sequence[int] = slice(None)) -> Array:
        """Expected cost c_rob + (1 - ρ) c_fail of attempts; a failure that cannot happen costs nothing.

        Args:
            probability: ρ, its last axis over the tasks.
            tasks: which ones; all if none are given.
        """
        risk, c_fail = 1.0 - probability, self.c_fail[tasks]
        if (never := np.isinf(c_fail)).any():
            c_fail, risk = np.where(never, 1.0, c_fail), np.where(never & (risk > 0.0), np.inf, risk)
        return cast(Array, self.c_rob[tasks] + risk * c_fail)


@dataclass(frozen=True)
class Certificate:
    """Why a lower bound holds: a tree of cases, each with multipliers v of the assignment constraints.

    L(v) = Σ_i v_i + Σ_j min(0, f_j - Σ_i (v_i - c_ij)⁺) with v_i ≤ b_i bounds every solution from below. Where it
    cannot say enough, two cases follow, one with a facility open and one with it closed, each with a v of its own;
    nodes come after their parents, the root is node 0. A node with one child only tightens what is known before it.
    `p2l.team.certificate` recomputes the bound that all this proves; nothing here has to be believed.

    Cases may also be of how many facilities are open, a demand left outside counted as one: "more than k" has F + k in
    the place of a facility. A price μ then makes every one that is open cheaper, or dearer if it is negative, and is
    paid back as often as the case says at least, or at most.

    Attributes:
        multipliers: [R, D] v.
        row: [T] which of them a node has.
        parent: [T] of a node; -1 for the root.
        facility: [T] facility that is decided between its parent and a node; -1 if none is.
        is_open: [T] whether it is open there.
        target: the bound that the tree is to prove; cases at or above it were left out.
        prices: [R, K] λ of the K limits on what is opened, beside each v; none where nothing is limited. A limit
            Σ_j w_j y_j <= B adds λ w_j to every opening cost and takes λ B off L(v).
        count_prices: [R] μ beside each v; zeros if none are given.
    """

    multipliers: Array
    row: IntArray
    parent: IntArray
    facility: IntArray
    is_open: BoolArray
    target: float
    prices: Array = field(default_factory=lambda: np.zeros((0, 0)))
    count_prices: Array | None = None

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        put = object.__setattr__
        put(self, "multipliers", freeze("multipliers", self.multipliers, ("R", "D"), sizes))
        put(self, "row", freeze("row", self.row, ("T",), sizes, np.int64, low=0, high=len(self.multipliers) - 1))
        for name in ("parent", "facility"):
            put(self, name, freeze(name, getattr(self, name), ("T",), sizes, np.int64, low=-1))
        put(self, "is_open", freeze("is_open", self.is_open, ("T",), sizes, np.bool_))
        prices = self.prices if np.size(self.prices) else np.zeros((len(self.multipliers), 0))
        put(self, "prices", freeze("prices", prices, ("R", "K"), sizes, low=0.0, high=_FAR))
        count_prices = np.zeros(len(self.multipliers)) if self.count_prices is None else self.count_prices
        put(self, "count_prices", freeze("count_prices", count_prices, ("R",), sizes, low=-_FAR, high=_FAR))
        if not bool((np.abs(self.multipliers) <= _FAR).all()):
            raise ShapeError(f"multipliers: hold {np.abs(self.multipliers).max()}; expected at most {_FAR:g}")
        if math.isnan(self.target):
            raise ShapeError("target: is NaN; expected the bound that the tree is to prove")

    @classmethod
    def of(cls, multipliers: Array, prices: Array | None = None) -> Certificate:
        """The one of a single L(v), multipliers [D], at the prices [K] of limits."""
        one = np.zeros(1, dtype=np.int64)
        rows = np.zeros((0, 0)) if prices is None else np.asarray(prices)[None]
        return cls(np.asarray(multipliers)[None], one, one - 1, one - 1, one > 0, -math.inf, rows)


@dataclass(frozen=True)
class Plan:
    """A decision for every task, its expected cost, and a bound on what any plan must cost.

    Attributes:
        planner: name of the route that made it.
        status: "optimal" (proven to 1e-9 by the certificate), "feasible" (complete, but with a gap left), "time_limit"
            or "heuristic".
        sequence: [n] task indices in the order of work.
        decision: [n] a `Decision` per task.
        skill: [n] task whose lesson an attempt uses; the task itself when taught; -1 for pre-trained or none.
        p_success: [n] success probability (1 when delegated or taught).
        expected_cost: [n] expected cost of each task.
        objective: their sum.
        lower_bound: no plan of this problem costs less; what the certificate proves, rounding counted against it.
        gap: (objective - lower_bound) / objective, 0 when the objective is 0.
        seconds: wall time of the planner, in the first call of a process with what it had to load or compile.
        certificate: the proof of `lower_bound`, for `certificate.check_certificate`.

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
        freeze_columns(self, ("n",), ("sequence", "decision", "skill"), ("p_success", "expected_cost"))

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
        lower_bound: as in `Plan`.
        status: as in `Plan`.
        seconds: wall time, as in `Plan`.
        certificate: the proof of `lower_bound`.
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


def freeze_columns(record: object, shape: tuple[str], whole: tuple[str, ...], real: tuple[str, ...]) -> None:
    """Make columns of a frozen record read-only arrays of one length: whole numbers, and others.

    Raises:
        ShapeError: a column is no such array, or of another length than the first.
    """
    sizes: dict[str, int] = {}
    for name in (*whole, *real):
        kind = np.int64 if name in whole else np.float64
        object.__setattr__(record, name, freeze(name, getattr(record, name), shape, sizes, kind))


def relative_gap(cost: float, lower_bound: float) -> float:
    """(cost - lower_bound) / cost, at least 0; 0 when nothing costs anything."""
    return max(0.0, (cost - lower_bound) / cost) if cost > 0.0 else 0.0
