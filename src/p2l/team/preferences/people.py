"""Made-up people, and what each way of asking costs with them: planned by what is believed, judged by what is true.

Three kinds, as many of each. A person's cost of a family is drawn for each family by itself, lognormal:

    hurried      150 ± 30 in every family
    specialist   20 ± 5 in three families of four, 140 ± 28 in the others
    indifferent  100 ± 10 in every family

Over all kinds the mean is 100, the thesis's c_hum, and the standard deviation 54.5. What is believed of a person before
the first question is that it is one of these three, or else, for comparison, the same of each family by itself.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from p2l.records import Array, IntArray
from p2l.team.preferences.belief import priced
from p2l.team.preferences.dialogue import Policy, ask, everything, most_uncertain, nothing, worth_most
from p2l.team.preferences.record import CostPrior, Kinds, Preferences
from p2l.team.preferences.values import Optima
from p2l.team.problem import Decision
from p2l.team.shop import Shop, ShopPlan
from p2l.team.shop.outcome import attempt_cost

POLICIES = ("nothing", "everything", "uncertain", "worth", "worth_alone", "known")


@dataclass(frozen=True)
class Kind:
    """A kind of people: the cost of each family is lognormal, of one of some parts (share, mean, sd)."""

    name: str
    parts: tuple[tuple[float, float, float], ...]

    def costs(self, families: int, rng: np.random.Generator) -> Array:
        """[F] costs of a person."""
        share, mean, sd = (np.array(column) for column in zip(*self.parts, strict=True))
        part = rng.choice(len(share), families, p=share)
        scale = np.sqrt(np.log1p((sd[part] / mean[part]) ** 2))
        return np.asarray(mean[part] * np.exp(scale * rng.standard_normal(families) - scale**2 / 2.0))

    def below(self, cost: Array, power: int) -> Array:
        """Expectation of cost^power over the costs below each of some: for 0 their probability, for 1 their mean."""
        total: Array = np.zeros(len(cost))
        for share, mean, sd in self.parts:
            scale = math.sqrt(math.log1p((sd / mean) ** 2))
            standard = (np.log(cost / mean) + scale**2 / 2.0) / scale
            total = total + share * mean**power * special.ndtr(standard - power * scale)
        return total


KINDS = (
    Kind("hurried", ((1.0, 150.0, 30.0),)),
    Kind("specialist", ((0.75, 20.0, 5.0), (0.25, 140.0, 28.0))),
    Kind("indifferent", ((1.0, 100.0, 10.0),)),
)


def population(kinds: Sequence[Kind] = KINDS) -> tuple[float, float]:
    """Mean and standard deviation of a family's cost over as many people of each kind."""
    parts = [(share / len(kinds), mean, sd) for kind in kinds for share, mean, sd in kind.parts]
    mean = math.fsum(share * m for share, m, _ in parts)
    return mean, math.sqrt(math.fsum(share * (m**2 + sd**2) for share, m, sd in parts) - mean**2)


def stranger(member: IntArray, families: Sequence[str], points: int, kinds: Sequence[Kind] = KINDS) -> Preferences:
    """What is believed of a person of whom nothing is known, but that it is of one of some kinds, all as probable.

    The costs of everybody are parted into K ranges of equal probability; each point is the mean of its range.

    Args:
        member: [n] family of each task.
        families: F names.
        points: K.
        kinds: of people.
    """
    grid = np.geomspace(0.1, 10_000.0, 20_001)
    mean_below = [[kind.below(grid, power) for kind in kinds] for power in (0, 1)]
    together = np.mean(mean_below, axis=1)  # [2, grid] probability, and share of the mean, below a cost
    edges = np.interp(np.linspace(0.0, 1.0, points + 1)[1:-1], together[0], grid)
    parts = [np.concatenate([[0.0], np.interp(edges, grid, each), [each[-1]]]) for each in together]
    given = np.array([np.diff(np.concatenate([[0.0], kind.below(edges, 0), [1.0]])) for kind in kinds])
    chance = given.mean(axis=0)
    cost = np.diff(parts[1]) / np.diff(parts[0])
    prior = CostPrior(cost * (population(kinds)[0] / float(chance @ cost)), chance, closed=False)  # to the last digit
    common = Kinds(np.full(len(kinds), 1.0 / len(kinds)), (given,) * len(families))
    return Preferences(tuple(families), (prior,) * len(families), member, kinds=common)


@dataclass(frozen=True)
class Meeting:
    """A way of asking and a person: questions asked, and what the plan truly costs, without them."""

    policy: str
    questions: int
    plan_cost: float


def meetings(
    optima: Optima, true: Shop, cost: Array, c_ask: float, policies: Sequence[str] = POLICIES
) -> tuple[Meeting, ...]:
    """Every way of asking on one day with one person.

    `nothing`; `everything`; `uncertain`, as many questions as `worth` has asked, for the families of the largest
    variance; `worth`, the one-step value; `worth_alone`, the same with families believed to be independent; and
    `known`, the bound: all costs are known, and nothing was asked.

    Args:
        optima: plans of the day as it is planned, and what is believed before the first question.
        true: the day as it is; its c_hum does not matter where something is believed.
        cost: [F] of the person, who answers exactly.
        c_ask: of a question.
        policies: of `POLICIES`, those to look at.
    """
    shop, before = optima.shop, optima.preferences
    alone = replace(before, kinds=None)
    real = priced(true, before, cost)
    found: list[Meeting] = []
    budget = 0
    for name in sorted(policies, key=lambda each: each == "uncertain"):  # whose budget is that of `worth`
        if name == "known":
            found.append(Meeting(name, 0, kept_cost(real, optima.at(cost).plan)))
            continue
        ways: dict[str, Policy] = {
            "nothing": nothing(),
            "everything": everything(shop),
            "uncertain": most_uncertain(shop, budget),
        }
        policy = ways.get(name, worth_most(optima, c_ask))
        believed = alone if name == "worth_alone" else before
        done = ask(shop, believed, c_ask, cost.__getitem__, policy, optima=optima)
        budget = len(done.asked) if name == "worth" else budget
        found.append(Meeting(name, len(done.asked), kept_cost(real, done.plan)))
    return tuple(found)


def kept_cost(shop: Shop, plan: ShopPlan) -> float:
    """What the decisions of a plan, with the lesson behind each attempt, cost in another shop of the same tasks."""
    task, size = shop.groups
    robot, lesson = np.maximum(plan.robot, 0), np.maximum(plan.lesson, 0)
    taught = plan.lesson >= 0
    p = np.where(taught, shop.transfer[robot, lesson, task] if len(shop.lessons) else 0.0, shop.pretrained[robot, task])
    attempts = np.where(plan.decision == Decision.ACT, attempt_cost(shop, robot, task, p) * size, 0.0)
    person = np.where(plan.decision == Decision.DELEGATE, shop.c_hum[task] * size, 0.0)
    return math.fsum(
        [*attempts.tolist(), *person.tolist(), *shop.c_demo[plan.taught[:, 1], plan.taught[:, 0]].tolist()]
    )
