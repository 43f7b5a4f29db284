"""The symbolic skill graph (thesis, section 4.2.1): nominal skills to the goal, and recoveries into them.

Vertices are the preconditions ρ_1 … ρ_K, the goal, the failure modes and an absorbing *Fail*. In a chain nominal skill
k leads from ρ_k to the next precondition; in general (`SkillGraph.of_skills`) several skills may start at a
precondition, each reaches some of the others, or the goal, and falls into some of the failure modes. A recovery (i, j)
leads from mode i to precondition j; what does not succeed ends in *Fail*.

Reading of the thesis:
1. `R(s, a) = −c(s, a) − c_fail` (section 4.2) charges every skill, the formula of section 4.3.3 none for the recovery
   itself. A recovery is a skill, so `recovery_reward` is −1 like `skill_reward`; 0 gives the formula to the letter.
2. At a failure mode the robot may also give up, which is worth −c_fail: no mode is worth less (section 4.3.3 starts
   there). Both rewards and c_fail = 10 are settings of the author's experiments.
3. The thesis's graphs are chains whose skills end in *Fail* when they fail. Where a skill may fall into a failure mode
   that is known, what a recovery of that mode is worth counts before it, too, and the graph has cycles.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.errors import ConfigError, ShapeError
from p2l.records import Array, IntArray, freeze


@dataclass(frozen=True)
class NominalSkill:
    """An edge of a graph that is no chain.

    Attributes:
        name: of the skill.
        source: number of the precondition at which it may start.
        reaches: probability of each target, a precondition's number or K for the goal.
        falls: probability of each failure mode in which it may end; what is left is *Fail*.

    Example:
        >>> from p2l import NominalSkill
        >>> throw = NominalSkill("throw", source=0, reaches={2: 0.6}, falls={0: 0.3})  # in one of ten it is lost
    """

    name: str
    source: int
    reaches: Mapping[int, float]
    falls: Mapping[int, float] = field(default_factory=dict)


@dataclass(frozen=True)
class SkillGraph:
    """Success probabilities, sizes and rewards.

    Attributes:
        nominal: [K] probability that nominal skill k reaches the next precondition; zeros where `skills` says it.
        sizes: [I] ground states |ρ_f| in each failure mode, at least one.
        q: [I, M] probability that the recovery of mode i reaches target j; target K is the goal.
        skill_reward: of executing a nominal skill, at most 0.
        recovery_reward: of executing a recovery, at most 0.
        c_fail: penalty of *Fail*, above 0.
        skills: nominal skills of a graph that is no chain; none in a chain.

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
    skills: tuple[NominalSkill, ...] = ()

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
        put(self, "skills", tuple(self.skills))
        if self.skills:
            _check_skills(self)

    @classmethod
    def of_skills(cls, preconditions: int, skills: Sequence[NominalSkill], sizes: Array, **rest: Any) -> SkillGraph:
        """A graph with branches, several ways to the goal, and skills that fall into failure modes.

        Args:
            preconditions: K.
            skills: its nominal skills, in any order.
            sizes: [I].
            **rest: as in the constructor; `q` is 0 everywhere without it.

        Raises:
            ShapeError: a vertex that there is not, or probabilities of a skill that are none.
            ConfigError: nothing to start from, or preconditions among which the robot could go in circles for ever.

        Example:
            Two ways from the start: a direct one that may drop the object, and a slow one by a second precondition.

            >>> import numpy as np
            >>> from p2l import NominalSkill, SkillGraph
            >>> from p2l.metareskill.value_iteration import best_skills
            >>> direct = NominalSkill("throw", 0, {2: 0.6}, falls={0: 0.4})
            >>> slow = [NominalSkill("carry", 0, {1: 0.9}), NominalSkill("place", 1, {2: 0.9})]
            >>> graph = SkillGraph.of_skills(2, [direct, *slow], np.array([20.0]))
            >>> best_skills(graph), best_skills(graph.with_q(np.array([[0.9, 0.0, 0.0]])))
            (('carry', 'place'), ('throw', 'place'))
        """
        rest.setdefault("q", np.zeros((len(np.atleast_1d(sizes)), preconditions + 1)))
        return cls(nominal=np.zeros(preconditions), sizes=sizes, skills=tuple(skills), **rest)

    @property
    def edges(self) -> tuple[IntArray, Array, Array]:
        """Sources [S], probabilities of targets [S, M] and of failure modes [S, I], of the nominal skills."""
        modes, targets = self.q.shape
        if not self.skills:
            step = np.arange(targets - 1)
            reach = np.zeros((targets - 1, targets))
            reach[step, step + 1] = self.nominal
            return step, reach, np.zeros((targets - 1, modes))
        reach, fall = np.zeros((len(self.skills), targets)), np.zeros((len(self.skills), modes))
        for row, skill in enumerate(self.skills):
            for place, probability in skill.reaches.items():
                reach[row, place] = probability
            for place, probability in skill.falls.items():
                fall[row, place] = probability
        return np.array([skill.source for skill in self.skills], dtype=np.int64), reach, fall

    @property
    def share(self) -> Array:
        """[I] share of all failures that fall into each mode."""
        return np.asarray(self.sizes / self.sizes.sum())

    def with_q(self, q: Array) -> SkillGraph:
        """The same graph with other success probabilities [I, M] of the recoveries."""
        return dataclasses.replace(self, q=q)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """The record as named arrays, for `artifacts.save_arrays`."""
        plain = {
            one.name: np.asarray(getattr(self, one.name)) for one in dataclasses.fields(self) if one.name != "skills"
        }
        if not self.skills:
            return plain
        source, reach, fall = self.edges
        skills = np.array([skill.name for skill in self.skills])
        return {**plain, "skill_names": skills, "skill_source": source, "skill_reach": reach, "skill_fall": fall}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, npt.NDArray[Any]]) -> SkillGraph:
        """Rebuild the record; the constructor checks it."""
        scalars = {name: float(arrays[name]) for name in ("skill_reward", "recovery_reward", "c_fail")}
        skills = []
        if "skill_source" in arrays:
            rows = zip(
                *(arrays[f"skill_{name}"].tolist() for name in ("names", "source", "reach", "fall")), strict=True
            )
            for name, source, reach, fall in rows:
                possible = [{k: p for k, p in enumerate(part) if p > 0.0} for part in (reach, fall)]
                skills.append(NominalSkill(name, source, *possible))
        return cls(arrays["nominal"], arrays["sizes"], arrays["q"], **scalars, skills=tuple(skills))


def _check_skills(graph: SkillGraph) -> None:
    """Refuse skills that lead nowhere that there is, or in circles."""
    modes, targets = graph.q.shape
    if not graph.skill_reward < 0.0:
        raise ConfigError("skill_reward: 0 given; a graph that may have cycles needs skills that cost something")
    for skill in graph.skills:
        known = {"source": [skill.source], "reaches": list(skill.reaches), "falls": list(skill.falls)}
        for what, count in (("source", targets - 1), ("reaches", targets), ("falls", modes)):
            if bad := [place for place in known[what] if place not in range(count)]:
                raise ShapeError(f"skill '{skill.name}': {what} names {bad[0]}; there are 0 to {count - 1}")
        probabilities = [*skill.reaches.values(), *skill.falls.values()]
        if not all(0.0 <= p <= 1.0 for p in probabilities) or sum(probabilities) > 1.0 + 1e-9:
            raise ShapeError(f"skill '{skill.name}': {probabilities} are no probabilities, or more than 1 together")
    source, reach, fall = graph.edges
    exits = (reach[:, -1] > 0.0) | (fall.sum(axis=1) > 0.0) | (reach.sum(axis=1) < 1.0 - 1e-9)
    leaves = set(source[exits].tolist())
    leaves |= set(range(targets - 1)) - set(source.tolist())  # nothing starts there: the robot is stranded
    while more := {int(s) for s, r in zip(source, reach, strict=True) if any(r[v] > 0 for v in leaves)} - leaves:
        leaves |= more
    if circling := sorted(set(range(targets - 1)) - leaves):
        raise ConfigError(f"preconditions {circling}: their skills lead to each other for ever, and nowhere else")
