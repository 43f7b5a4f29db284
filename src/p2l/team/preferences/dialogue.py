"""Asking: a policy says which family is next, a person answers, until the policy has no more questions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from p2l.team.preferences.belief import after_answer
from p2l.team.preferences.record import Preferences
from p2l.team.preferences.values import Optima, next_question, open_families
from p2l.team.shop import Shop, ShopPlan

Answer = Callable[[int], float]  # what the person says about a family's cost
Policy = Callable[[Preferences, tuple[int, ...]], int | None]  # beliefs and what was asked → next family


@dataclass(frozen=True)
class Dialogue:
    """What was asked, and the plan that came of it.

    Attributes:
        asked: families in the order of the questions.
        answers: what was said.
        preferences: what is believed at the end.
        plan: the best at the mean of that.
        spent: cost of the questions.
    """

    asked: tuple[int, ...]
    answers: tuple[float, ...]
    preferences: Preferences
    plan: ShopPlan
    spent: float

    @property
    def expected_cost(self) -> float:
        """Of the plan by what is believed, and of the questions."""
        return self.plan.objective + self.spent


def ask(
    shop: Shop, preferences: Preferences, c_ask: float, answer: Answer, policy: Policy | None = None,
    *, optima: Optima | None = None,
) -> Dialogue:  # fmt: skip
    """Ask while a policy has questions; by itself, the one worth most while it is worth more than it costs.

    Args:
        shop: the day.
        preferences: what is believed before.
        c_ask: cost of a question.
        answer: the person.
        policy: what to ask next; None: `worth_most`.
        optima: of this shop and these families, if there are some already.

    Raises:
        ConfigError: an answer that is no cost, or that a closed belief rules out; no plan keeps the shop's limits.
        SolverError: no plan was found in time.
    """
    optima = Optima(shop, preferences) if optima is None else optima
    choose = worth_most(optima, c_ask) if policy is None else policy
    asked: list[int] = []
    answers: list[float] = []
    while (family := choose(preferences, tuple(asked))) is not None:
        said = answer(family)
        preferences = after_answer(preferences, family, said)
        asked.append(family)
        answers.append(said)
    plan = optima.at(preferences.mean).plan
    return Dialogue(tuple(asked), tuple(answers), preferences, plan, c_ask * len(asked))


def worth_most(optima: Optima, c_ask: float, look_ahead: int = 1) -> Policy:
    """Ask what is worth most, while it is worth more than it costs."""

    def choose(preferences: Preferences, _: tuple[int, ...]) -> int | None:
        best = next_question(optima.shop, preferences, c_ask, look_ahead=look_ahead, optima=optima)
        return None if best is None else best.family

    return choose


def nothing() -> Policy:
    """Ask nothing: plan for the mean."""
    return lambda *_: None


def everything(shop: Shop) -> Policy:
    """Ask once for every family that has a task today, in the order of the families."""

    def choose(preferences: Preferences, asked: tuple[int, ...]) -> int | None:
        return next((each for each in open_families(shop, preferences) if each not in asked), None)

    return choose


def most_uncertain(shop: Shop, budget: int) -> Policy:
    """Ask `budget` times for the family whose cost is least known (largest variance; the first of equal ones).

    It has no rule for stopping of its own: give it as many questions as another policy has asked.
    """

    def choose(preferences: Preferences, asked: tuple[int, ...]) -> int | None:
        left = [each for each in open_families(shop, preferences) if each not in asked]
        return max(left, key=lambda each: preferences.variance[each]) if left and len(asked) < budget else None

    return choose
