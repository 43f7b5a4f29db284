"""What is believed of a person's costs: a distribution of c_hum for each family of tasks (thesis, section 6.2.2).

Axis letters of this room, beside those of a shop: F families, K costs that one of them may have.

Deviations. The thesis leaves preferences as future work; what its author published of it later is COIL (Vats et al.,
"Optimal interactive learning on the job via facility location planning"), which is what we depart from:
    1. COIL's preferences are about which way a task is to be done: a robot that does not know has to ask, or fails.
       Ours are about who does what: the person does any task as it should be, at a cost that only the person knows.
    2. COIL plans robot, person, lessons and questions in one facility location program, which opens a question as it
       opens a lesson. Here a question is worth what its answer is expected to save, and plans are made after it.
    3. Families are independent, so that an answer says nothing of another family, unless there are `Kinds` of people:
       then it says which kind this may be, and by that what the other families cost.
    4. COIL's prices are robot 10, person 80, lesson 50, 100 or 200, question 20, failure 100. `conf/ask.yaml` has no
       price of a question: it is in the unit of the orders, and the person's to say.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from p2l.errors import ShapeError
from p2l.records import Array, IntArray, freeze
from p2l.team.costs import LARGEST

_SUM = 1e-9  # of probabilities that sum to one but for rounding


@dataclass(frozen=True)
class CostPrior:
    """What is believed of one family's c_hum.

    Attributes:
        cost: [K] what it may be, ascending, each once; at least 0 and finite.
        probability: [K] of each; they sum to 1.
        closed: whether it can be nothing else. Else each cost stands for a range around it, of which it is the mean.

    Raises:
        ShapeError: no costs, or not in order; probabilities that are none, or do not sum to 1.

    Example:
        >>> from p2l.team.preferences import CostPrior
        >>> prior = CostPrior(cost=[20.0, 140.0], probability=[0.75, 0.25])
        >>> prior.mean, prior.variance
        (50.0, 2700.0)
    """

    cost: Array
    probability: Array
    closed: bool = True

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        object.__setattr__(self, "cost", freeze("cost", self.cost, ("K",), sizes, low=0.0, high=LARGEST))
        chance = freeze("probability", self.probability, ("K",), sizes, low=0.0, high=1.0)
        if not len(self.cost) or (np.diff(self.cost) <= 0.0).any():
            raise ShapeError("cost: expected at least one cost, in ascending order, each once")
        if not math.isclose(math.fsum(chance.tolist()), 1.0, abs_tol=_SUM):
            raise ShapeError(f"probability: {chance.tolist()} given; expected numbers that sum to 1")
        object.__setattr__(self, "probability", chance)

    @property
    def mean(self) -> float:
        """Expected cost."""
        return math.fsum((self.cost * self.probability).tolist())

    @property
    def variance(self) -> float:
        """Of the K costs; of what they stand for it is more."""
        return math.fsum(((self.cost - self.mean) ** 2 * self.probability).tolist())

    @property
    def is_certain(self) -> bool:
        """Whether one cost has all the probability."""
        return int((self.probability > 0.0).sum()) == 1


@dataclass(frozen=True)
class Kinds:
    """Kinds of people, of whom one is to be asked; given the kind, families are independent.

    Attributes:
        weight: [H] probability of each of H kinds.
        given: of each of F families, [H, K] probability of its K costs if the person is of a kind.

    Raises:
        ShapeError: probabilities that are none, or do not sum to 1.
    """

    weight: Array
    given: tuple[Array, ...]

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        object.__setattr__(self, "weight", freeze("weight", self.weight, ("H",), sizes, low=0.0, high=1.0))
        given = tuple(freeze("given", each, ("H", "K"), {"H": sizes["H"]}, low=0.0, high=1.0) for each in self.given)
        object.__setattr__(self, "given", given)
        for each in (self.weight[None], *given):
            if not np.allclose(each.sum(axis=1), 1.0, rtol=0.0, atol=_SUM):
                raise ShapeError(f"kinds: probabilities sum to {each.sum(axis=1).tolist()}; expected 1 of each kind")


@dataclass(frozen=True)
class Preferences:
    """What is believed of a person.

    Attributes:
        families: F distinct names.
        prior: F beliefs, independent of each other unless there are kinds.
        member: [n] family of each task of a shop; -1 where its c_hum is known, as the shop has it.
        noise: standard deviation of what a person says about the true cost; 0: answers are exact.
        kinds: of people, if there are some; each prior is then what they come to together.

    Raises:
        ShapeError: a repeated family, other numbers of beliefs than families, a family that there is not; kinds that do
            not come to the priors.
    """

    families: tuple[str, ...]
    prior: tuple[CostPrior, ...]
    member: IntArray
    noise: float = 0.0
    kinds: Kinds | None = None

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "families", tuple(self.families))
        put(self, "prior", tuple(self.prior))
        if len(set(self.families)) < len(self.families) or len(self.families) != len(self.prior):
            raise ShapeError(f"families: {list(self.families)} with {len(self.prior)} beliefs; expected one of each")
        last = len(self.families) - 1
        put(self, "member", freeze("member", self.member, ("n",), {}, np.int64, low=-1, high=last))
        if not 0.0 <= self.noise < math.inf:
            raise ShapeError(f"noise: {self.noise} given; expected a finite number of at least 0")
        if self.kinds is not None:
            together = [self.kinds.weight @ each for each in self.kinds.given]
            fits = [
                len(each) == len(prior.cost) and np.allclose(each, prior.probability, rtol=0.0, atol=_SUM)
                for each, prior in zip(together, self.prior, strict=False)
            ]
            if len(together) != len(self.prior) or not all(fits):
                raise ShapeError("kinds: do not come to what is believed of each family")

    @property
    def mean(self) -> Array:
        """[F] expected costs."""
        return np.array([each.mean for each in self.prior], dtype=np.float64)

    @property
    def variance(self) -> Array:
        """[F] variances of the costs."""
        return np.array([each.variance for each in self.prior], dtype=np.float64)
