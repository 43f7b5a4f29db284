"""What the robot does when an option has ended: the high-level policy, and the heuristics that it is compared with.

At every end the preconditions are evaluated on the most likely state, that is on what the robot sees. If one holds, the
nominal skill of the most valuable one follows. If none does, the strategies differ (thesis, section 4.4.1, table 4.1):

- `recoveries`: the failure classifier names the mode; the best learnt recovery of that mode by the graph's values.
- `retry`: the skill that has just been executed, once more.
- `to_previous`: straight to where the skill that has just been executed should have started.
- `to_start`: straight to where the chain starts.
- `no_recovery`: the episode ends.
- `open_loop`: preconditions are not looked at; the chain is executed once.

Where the thesis is silent:
1. Every episode begins with the first skill. Success is perceived: an episode ends when the task is done.
2. A straight motion leads to the mean of the target's D⁺ for the object as seen, the fingers as there; the motion and
   its timing are those with which REPS begins. "The skill that has just been executed" is the last nominal one.
3. A recovery that has just led nowhere, that is to the same mode again, gives way to the next best one, in turns, up
   to the limit of skills: what an open-loop motion did not change it will not change the second time either.
4. Where the graph values giving up above every recovery, the best one is tried all the same: an episode that ends
   there has failed for sure.
5. A nominal skill that has just been executed, and whose own precondition is still the most valuable one that holds,
   has led nowhere either: the robot is lost as if none held. Only `no_recovery`, which has nothing else to do, repeats
   it. A learnt precondition also holds in states that the skill does not change: of a development run's failures on
   unseen levers, nine in ten had repeated the first skill up to the limit.

Axis letters: N rows, K nominal skills, I modes, M targets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from p2l.errors import ConfigError
from p2l.failures.classifier import ModeClassifier
from p2l.records import IntArray
from p2l.recoveries.metareskill.graph import SkillGraph
from p2l.recoveries.metareskill.value_iteration import NONE, nominal_policy, recovery_ranking
from p2l.recoveries.regression import ParameterisedSkill
from p2l.recoveries.strategy import STRATEGIES
from p2l.recoveries.target import Task
from p2l.skills.chain import FINISH, Choose, Moments, in_order
from p2l.skills.option import Option
from p2l.skills.relative import Plan, Timing, relative
from p2l.worlds.observation import Observation

Skills = Mapping[tuple[int, int], ParameterisedSkill]
Otherwise = Callable[[IntArray, Observation], IntArray]


@dataclass(frozen=True)
class Playbook:
    """Options, and what chooses among them.

    Attributes:
        options: nominal ones first, then recoveries.
        choose: for `skills.chain.run`.
    """

    options: tuple[Option, ...]
    choose: Choose


@dataclass(frozen=True)
class _Policy:
    """The high-level policy, but for what to do where no precondition holds.

    Attributes:
        task: world and preconditions.
        graph: values of preconditions.
        max_options: an episode ends after as many.
    """

    task: Task
    graph: SkillGraph
    max_options: int

    def choose(self, otherwise: Otherwise, *, repeat: bool = False) -> Choose:
        """`otherwise` maps the option that was executed last [N], and what is seen, to options [N].

        `repeat`: whether a nominal skill may follow itself.
        """
        rng = np.random.default_rng(0)  # `nominal_policy` wants one; preconditions are no tie, each is a skill apart

        def choose(ended: Moments) -> IntArray:
            seen = self.task.world.observe(ended.rows)
            done = self.task.world.goal(ended.rows)
            holds = self.task.preconditions.holds(self.task.symbols.state(seen), done)
            following = nominal_policy(self.graph, holds, rng)
            over = done | (ended.rows.actions >= self.max_options)
            nowhere = following == (NONE if repeat else ended.option)
            lost = ((following == NONE) | nowhere) & ~over
            following[over] = FINISH
            if lost.any():
                following[lost] = otherwise(ended.option[lost], seen.take(lost))
            return following

        return choose


def playbook(
    strategy: str,
    task: Task,
    nominal: Sequence[Option],
    graph: SkillGraph,
    timing: Timing,
    rng: np.random.Generator,
    *,
    modes: ModeClassifier | None = None,
    skills: Skills | None = None,
    max_options: int = 10,
) -> Playbook:
    """The options and the policy of a strategy.

    Args:
        strategy: one of `STRATEGIES`.
        task: world and preconditions.
        nominal: K options.
        graph: values of preconditions, and of the recoveries where there are some.
        timing: of recoveries.
        rng: breaks ties among equally valuable recoveries, once.
        modes: the failure classifier, for `recoveries`.
        skills: by (mode, target), for `recoveries`.
        max_options: an episode ends after as many.

    Raises:
        ConfigError: an unknown strategy, or one without what it needs.
    """
    if strategy not in STRATEGIES:
        raise ConfigError(f"unknown strategy '{strategy}'; known: {', '.join(STRATEGIES)}")
    if strategy == "open_loop":
        return Playbook(tuple(nominal), in_order(nominal))
    policy = _Policy(task, graph, max_options)
    if strategy == "recoveries":
        if modes is None or skills is None:
            raise ConfigError("strategy 'recoveries' needs failure modes and learnt skills")
        return _recoveries(policy, nominal, timing, rng, modes, skills)
    count = len(nominal)
    moves = tuple(relative(f"to_{name}", _straight(task, k), timing) for k, name in enumerate(task.targets[:-1]))
    otherwise: dict[str, Otherwise] = {
        "retry": lambda last, _seen: last % count,
        "to_previous": lambda last, _seen: count + last % count,
        "to_start": lambda last, _seen: np.full_like(last, count),
        "no_recovery": lambda last, _seen: np.full_like(last, FINISH),
    }
    return Playbook((*nominal, *moves), policy.choose(otherwise[strategy], repeat=strategy == "no_recovery"))


def _recoveries(
    policy: _Policy,
    nominal: Sequence[Option],
    timing: Timing,
    rng: np.random.Generator,
    modes: ModeClassifier,
    skills: Skills,
) -> Playbook:
    task, ranking = policy.task, recovery_ranking(policy.graph, rng)
    option = np.full(ranking.shape, FINISH)
    learnt: list[Option] = []
    for (mode, rank), target in np.ndenumerate(ranking):
        if target != NONE:
            option[mode, rank] = len(nominal) + len(learnt)
            plan = _learnt(task, skills[mode, int(target)], int(target))
            learnt.append(relative(f"recovery_{mode}_{task.targets[target]}", plan, timing))
    feasible = (option != FINISH).sum(axis=1)

    def recover(last: IntArray, seen: Observation) -> IntArray:
        mode = modes.classify(seen)[0]
        again = option[mode] == last[:, None]
        following = np.where(again.any(axis=1), again.argmax(axis=1) + 1, 0)
        return np.asarray(option[mode, following % np.maximum(feasible[mode], 1)])

    return Playbook((*nominal, *learnt), policy.choose(recover))


def _straight(task: Task, target: int) -> Plan:
    return lambda seen: task.straight(seen, target)


def _learnt(task: Task, skill: ParameterisedSkill, target: int) -> Plan:
    return lambda seen: task.recovery(skill, target, seen)
