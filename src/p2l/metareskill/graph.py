"""The symbolic skill graph (thesis, section 4.2.1): a chain of nominal skills to the goal, and recoveries into it.

Vertices are the preconditions ρ_1 … ρ_K, the goal, the failure modes and an absorbing *Fail*. Nominal skill k leads
from ρ_k to the next precondition, a recovery (i, j) from mode i to precondition j; what does not succeed ends in
*Fail*.

Reading of the thesis:
1. `R(s, a) = −c(s, a) − c_fail` (section 4.2) charges every skill, the formula of section 4.3.3 none for the recovery
   itself. A recovery is a skill, so `recovery_reward` is −1 like `skill_reward`; 0 gives the formula to the letter.
2. At a failure mode the robot may also give up, which is worth −c_fail: no mode is worth less (section 4.3.3 starts
   there). Both rewards and c_fail = 10 are settings of the author's experiments.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.errors import ConfigError, ShapeError
from p2l.records import Array, freeze


@dataclass(frozen=True)
class SkillGraph:
    """Success probabilities, sizes and rewards.

    Attributes:
        nominal: [K] probability that nominal skill k reaches the next precondition.
        sizes: [I] ground states |ρ_f| in each failure mode, at least one.
        q: [I, M] probability that the recovery of mode i reaches target j; target K is the goal.
        skill_reward: of executing a nominal skill, at most 0.
        recovery_reward: of executing a recovery, at most 0.
        c_fail: penalty of *Fail*, above 0.

    Example:
        Two nominal skills to the goal, and two failure modes, one twice as common; no recovery is trained yet.

        >>> import numpy as np
        >>> from p2l import SkillGraph
        >>> graph = SkillGraph(nominal=np.array([0.9, 0.8]), sizes=np.array([20.0, 10.0]), q=np.zeros((2, 3)))
        >>> graph.share.round(2).tolist()
        [0.67, 0.33]
    """

    nominal: Array
    sizes: Array
    q: Array
    skill_reward: float = -1.0
    recovery_reward: float = -1.0
    c_fail: float = 10.0

    def __post_init__(self) -> None:
        sizes: dict[str, int] = {}
        put = object.__setattr__
        put(self, "nominal", freeze("nominal", self.nominal, ("K",), sizes, low=0.0, high=1.0))
        sizes["M"] = sizes["K"] + 1
        put(self, "sizes", freeze("sizes", self.sizes, ("I",), sizes, low=0.0))
        put(self, "q", freeze("q", self.q, ("I", "M"), sizes, low=0.0, high=1.0))
        if not sizes["I"]:
            raise ShapeError("sizes: no failure mode given; a skill graph needs at least one")
        if empty := np.flatnonzero(self.sizes == 0.0).tolist():
            raise ShapeError(f"sizes: failure modes {empty} are empty; leave them out, or cluster into fewer modes")
        for name in ("skill_reward", "recovery_reward"):
            if not -math.inf < getattr(self, name) <= 0.0:
                raise ConfigError(f"{name}: {getattr(self, name)} given; it must be finite and at most 0")
        if not 0.0 < self.c_fail < math.inf:
            raise ConfigError(f"c_fail: {self.c_fail} given; it must be finite and above 0")

    @property
    def share(self) -> Array:
        """[I] share of all failures that fall into each mode."""
        return np.asarray(self.sizes / self.sizes.sum())

    def with_q(self, q: Array) -> SkillGraph:
        """The same graph with other success probabilities [I, M] of the recoveries."""
        return dataclasses.replace(self, q=q)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """The record as named arrays, for `artifacts.save_arrays`."""
        return {field.name: np.asarray(getattr(self, field.name)) for field in dataclasses.fields(self)}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> SkillGraph:
        """Rebuild the record; the constructor checks it."""
        scalars = {name: float(arrays[name]) for name in ("skill_reward", "recovery_reward", "c_fail")}
        return cls(arrays["nominal"], arrays["sizes"], arrays["q"], **scalars)
