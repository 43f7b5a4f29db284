"""What a question is worth: preposterior analysis (Raiffa and Schlaifer, 1961) of a person's costs.

    value(f) = optimum at the mean of what is believed - Σ_answers P(answer) · optimum at the mean believed after it

The optimum is the least of functions that are linear in the costs, so it is concave in them, and no value is negative
(Jensen); it is 0 where one plan is best after every answer. Each optimum is one facility location problem, solved with
a certificate; between two costs at which one plan is best it is best throughout, which saves most solutions where
families are independent. Where there are kinds of people, an answer moves the means of all families.

A question is asked while it is worth more than it costs. Looking one question ahead misses those that only pay
together: if a lesson is spared only when the person is cheap at both of two families, no single answer changes the
plan, each question is worth 0, and none is asked. With `look_ahead=2` what the next question would then be worth is
added, in expectation over the answers:

    worth(b, 0) = 0,  worth(b, d) = max(0, max_f value(f) - c_ask + Σ_answers P(answer) · worth(b after it, d - 1))

for F times as many solutions; three that only pay together are missed again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from p2l.errors import ConfigError
from p2l.records import Array
from p2l.team.preferences.belief import possible_answers, priced
from p2l.team.preferences.record import Preferences
from p2l.team.problem import Decision
from p2l.team.shop import Shop, ShopPlan, plan_shop

_ZERO = 1e-8  # relative to the optimum: differences below it are rounding
_DEEPEST = 3
Progress = Callable[[int, int], None]


@dataclass(frozen=True)
class QuestionValue:
    """What asking for one family's cost is worth, in the unit of the costs.

    Attributes:
        family: its number.
        value: expected saving by the plans made after the answer.
        ahead: expected gain, prices taken off, of the questions that would then follow; 0 if nobody looks ahead.
        slack: by how much `value` may be wrong, as plans are not proven optimal; 0 if all are.
    """

    family: int
    value: float
    ahead: float
    slack: float

    def net(self, c_ask: float) -> float:
        """What is gained by asking, the question paid."""
        return self.value + self.ahead - c_ask


@dataclass(frozen=True)
class Optimum:
    """An optimal plan at some costs of the families.

    Attributes:
        plan: of the shop at these costs.
        cost: [F] these costs.
        copies: [F] copies of tasks of each family that it hands over.
        slack: what it may cost beyond the optimum.
    """

    plan: ShopPlan
    cost: Array
    copies: Array
    slack: float

    def at(self, cost: Array) -> float:
        """What the same plan costs at other costs [F]."""
        return self.plan.objective + float(self.copies @ (cost - self.cost))


class Optima:
    """The optimal plans of a shop at any costs of a person; remembers those that it has made."""

    def __init__(self, shop: Shop, preferences: Preferences, *, time_limit_s: float = 60.0) -> None:
        self.shop, self.preferences, self.time_limit_s = shop, preferences, time_limit_s
        self._known: dict[bytes, Optimum] = {}

    @property
    def solved(self) -> int:
        """How many plans have been made."""
        return len(self._known)

    def at(self, cost: Array) -> Optimum:
        """The plan at costs [F].

        Raises:
            ConfigError: no plan keeps the limits and the decisions.
            SolverError: no plan was found in time.
        """
        key = cost.tobytes()
        if key not in self._known:
            plan = plan_shop(priced(self.shop, self.preferences, cost), time_limit_s=self.time_limit_s)
            copies = self._copies(plan)
            slack = 0.0 if plan.status == "optimal" else plan.objective - plan.lower_bound
            self._known[key] = Optimum(plan, cost.copy(), copies, slack)
        return self._known[key]

    def along(self, cost: Array, family: int, points: Array) -> tuple[Array, Array]:
        """[A] optima, and [A] by how much they may be too large, where one family's cost is each of A points."""
        order = np.argsort(points, kind="stable")
        at = np.repeat(cost[None], len(points), axis=0)
        at[:, family] = points
        value, slack = np.full(len(points), np.nan), np.zeros(len(points))

        def solve(place: int) -> Optimum:
            optimum = self.at(at[order[place]])
            value[order[place]], slack[order[place]] = optimum.plan.objective, optimum.slack
            return optimum

        def fill(low: int, high: int, one: Optimum, other: Optimum) -> None:
            if high - low < 2:
                return
            for best, end in ((one, high), (other, low)):  # best at both ends, so in between: the optimum is concave
                there = value[order[end]]
                if best.at(at[order[end]]) <= there + _ZERO * max(1.0, abs(there)):
                    inner = order[low + 1 : high]
                    value[inner] = [best.at(each) for each in at[inner]]
                    slack[inner] = max(one.slack, other.slack)
                    return
            middle = (low + high) // 2
            between = solve(middle)
            fill(low, middle, one, between)
            fill(middle, high, between, other)

        last = len(points) - 1
        first = solve(0)
        fill(0, last, first, solve(last))
        return value, slack

    def _copies(self, plan: ShopPlan) -> Array:
        """[F] copies that a plan hands over, of tasks whose cost is not known."""
        task, size = self.shop.groups
        family = np.where(np.isfinite(self.shop.c_hum), self.preferences.member, -1)[task]
        counted = (plan.decision == Decision.DELEGATE) & (family >= 0)
        copies = np.bincount(family[counted], size[counted], minlength=len(self.preferences.families))
        return np.asarray(copies, dtype=np.float64)


def question_values(
    shop: Shop, preferences: Preferences, c_ask: float, *, look_ahead: int = 1, optima: Optima | None = None,
    progress: Progress | None = None,
) -> tuple[QuestionValue, ...]:  # fmt: skip
    """What each question is worth, the one that is worth most first.

    A question about a family without a task that the person can do is worth 0, unless it tells the kind of person.

    Args:
        shop: the day; its c_hum counts where nothing is believed.
        preferences: what is believed.
        c_ask: cost of a question, for what follows after it.
        look_ahead: questions in a row that are considered; see the module.
        optima: of this shop and these families, if there are some already.
        progress: is told how many questions are done.

    Raises:
        ConfigError: a negative c_ask, a look-ahead that there is not, no plan keeps the shop's limits.
        SolverError: no plan was found in time.

    Example:
        Two tasks; a lesson on the first does both. A person who is quick is better than that.

        >>> import numpy as np
        >>> from p2l import Problem, Shop
        >>> from p2l.team.preferences import CostPrior, Preferences, question_values
        >>> cost = {name: np.full(2, value) for name, value in (("c_rob", 10.0), ("c_hum", 80.0), ("c_fail", 100.0))}
        >>> day = Shop.of_problem(Problem(("peg", "pin"), **cost, c_demo=np.full(2, 100.0), pretrained=np.zeros(2),
        ...                               transfer=np.ones((2, 2))))
        >>> believed = Preferences(("small parts",), (CostPrior([20.0, 140.0], [0.5, 0.5]),), member=[0, 0])
        >>> [round(each.value, 6) for each in question_values(day, believed, c_ask=20.0)]
        [35.0]

        At the mean, 80, the lesson is given (110); at 20 the person does both (40): 110 - (40 + 110) / 2 = 35.
    """
    _check(c_ask, look_ahead)
    optima = Optima(shop, preferences) if optima is None else optima
    values = []
    for family in range(len(preferences.families)):
        values.append(_question(preferences, family, c_ask, look_ahead, optima))
        if progress is not None:
            progress(family + 1, len(preferences.families))
    return tuple(sorted(values, key=lambda each: (-each.net(c_ask), each.family)))


def next_question(
    shop: Shop, preferences: Preferences, c_ask: float, *, look_ahead: int = 1, optima: Optima | None = None
) -> QuestionValue | None:
    """The question that is worth most, or None if none is worth its cost.

    Raises:
        ConfigError, SolverError: as `question_values`.
    """
    values = question_values(shop, preferences, c_ask, look_ahead=look_ahead, optima=optima)
    return values[0] if values and values[0].net(c_ask) > 0.0 else None


def _question(preferences: Preferences, family: int, c_ask: float, look_ahead: int, optima: Optima) -> QuestionValue:
    now = optima.at(preferences.mean)
    has_use = family in open_families(optima.shop, preferences) or preferences.kinds is not None
    if preferences.prior[family].is_certain or not has_use:
        return QuestionValue(family, 0.0, 0.0, 0.0)
    chance, after = possible_answers(preferences, family)
    means = np.array([each.mean for each in after])
    if preferences.kinds is None:  # the other families stay as they are
        then, slack = optima.along(preferences.mean, family, means[:, family])
    else:
        each_optimum = [optima.at(mean) for mean in means]
        then, slack = (
            np.array(column) for column in zip(*((o.plan.objective, o.slack) for o in each_optimum), strict=True)
        )
    value = now.plan.objective - float(chance @ then)
    value = value if value > _ZERO * max(1.0, now.plan.objective) else 0.0
    ahead = 0.0
    if look_ahead > 1:
        ahead = float(chance @ [_worth(each, c_ask, look_ahead - 1, optima) for each in after])
    return QuestionValue(family, value, ahead, max(now.slack, float(chance @ slack)))


def _worth(preferences: Preferences, c_ask: float, look_ahead: int, optima: Optima) -> float:
    """Gain by the best of the questions that may follow, or by none."""
    families = range(len(preferences.families))
    return max(0.0, *(_question(preferences, each, c_ask, look_ahead, optima).net(c_ask) for each in families))


def open_families(shop: Shop, preferences: Preferences) -> list[int]:
    """Families with a task that the person can do."""
    return sorted(set(preferences.member[np.isfinite(shop.c_hum)].tolist()) - {-1})


def _check(c_ask: float, look_ahead: int) -> None:
    if not c_ask >= 0.0:
        raise ConfigError(f"c_ask: {c_ask} given; expected a cost of at least 0")
    if not 1 <= look_ahead <= _DEEPEST:
        raise ConfigError(f"look_ahead: {look_ahead} given; expected 1 to {_DEEPEST}")
