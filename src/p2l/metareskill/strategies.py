"""What the robot does when an option has ended: the high-level policy, and the heuristics that it is compared with.

At every end the preconditions are evaluated on the most likely state, that is on the observation. If one holds, the
nominal skill of the most valuable one follows. If none does, the strategies differ (thesis, section 4.4.1, table 4.1):

- `recoveries`: the failure classifier names the mode; the best learnt recovery of that mode by the graph's values.
- `retry`: the skill that has just been executed, once more.
- `to_previous`: straight to where the skill that has just been executed should have started.
- `to_start`: straight to where the chain starts.
- `no_recovery`: the episode ends.
- `recoveries_repeating`: `recoveries` without the no-progress rule (5 below), to know what it is worth.
- `open_loop`: preconditions are not looked at; the chain is executed once.

Where the thesis is silent:
1. Every episode begins with the first skill. Success is perceived: an episode ends when the task is done.
2. A straight motion leads to the mean of the target's D⁺ for the object as observed, the fingers as there; the motion
   and its timing are those with which REPS begins. "The skill that has just been executed" is the last nominal one.
3. A recovery's success rate is that of its first execution: after n executions in an episode it counts as q / (1 + n).
   What an open-loop motion did not change it will not change the second time either, so that the next best one has its
   turn, and then the best one again, up to the limit of skills.
4. Where the graph values giving up above every recovery, the best one is executed all the same: an episode that ends
   there is a failure for sure.
5. The no-progress rule: a nominal skill that has just been executed, and whose own precondition is still the most
   valuable one that holds, has led nowhere either: the robot is lost as if none held. `no_recovery`, which has nothing
   else to do, repeats it. A learnt precondition also holds in states that the skill does not change: of a development
   run's failures on unseen levers, nine in ten had repeated the first skill up to the limit.

Axis letters: N rows, K nominal skills, I modes, M targets.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from p2l.contracts.observation import Observation
from p2l.contracts.option import Option
from p2l.errors import ConfigError
from p2l.failures.classifier import ModeClassifier
from p2l.metareskill.graph import SkillGraph
from p2l.metareskill.regression import ParameterisedSkill
from p2l.metareskill.strategy_names import LEARNT, REPEATING, STRATEGIES
from p2l.metareskill.target import RecoveryTask
from p2l.metareskill.value_iteration import NONE, best_recovery, nominal_policy
from p2l.records import IntArray
from p2l.skills.chain import FINISH, Choose, Moments, in_order
from p2l.skills.relative import Plan, Timing, relative

Skills = Mapping[tuple[int, int], ParameterisedSkill]
Otherwise = Callable[[Moments, Observation], IntArray]


@dataclass(frozen=True)
class Playbook:
    """Options, and what chooses among them.

    Attributes:
        options: nominal ones first, then recoveries.
        choose: for one run of `skills.chain.run`; it remembers the recoveries of its episodes.
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

    task: RecoveryTask
    graph: SkillGraph
    max_options: int

    def choose(self, otherwise: Otherwise, *, no_progress: bool = True) -> Choose:
        """The policy as `skills.chain.run` takes it.

        Args:
            otherwise: options [N] for moments [N] at which the robot is lost, and their observations.
            no_progress: whether the robot is lost, too, where a nominal skill would follow itself (deviation 5).
        """
        rng = np.random.default_rng(0)  # `nominal_policy` wants one; preconditions are no tie, each is a skill apart

        def choose(moments: Moments) -> IntArray:
            observation = self.task.world.observe(moments.rows)
            done = self.task.world.goal(moments.rows)
            holds = self.task.preconditions.holds(self.task.symbols.state(observation), done)
            option = nominal_policy(self.graph, holds, rng)
            over = done | (moments.rows.actions >= self.max_options)
            lost = option == NONE
            if no_progress:
                lost |= option == moments.option
            lost &= ~over
            option[over] = FINISH
            if lost.any():
                option[lost] = otherwise(moments.take(lost), observation.take(lost))
            return option

        return choose


def playbook(
    strategy: str,
    task: RecoveryTask,
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
        modes: the failure classifier, for learnt recoveries.
        skills: by (mode, target), for learnt recoveries.
        max_options: an episode ends after as many.

    Raises:
        ConfigError: an unknown strategy, or one without what it needs.
    """
    if strategy not in STRATEGIES:
        raise ConfigError(f"unknown strategy '{strategy}'; known: {', '.join(STRATEGIES)}")
    if strategy == "open_loop":
        return Playbook(tuple(nominal), in_order(nominal))
    policy = _Policy(task, graph, max_options)
    if strategy in LEARNT:
        if modes is None or skills is None:
            raise ConfigError(f"strategy '{strategy}' needs failure modes and learnt skills")
        return _recoveries(policy, nominal, timing, rng, modes, skills, no_progress=strategy != REPEATING)
    count = len(nominal)
    moves = tuple(relative(f"to_{name}", _straight(task, k), timing) for k, name in enumerate(task.targets[:-1]))
    otherwise: dict[str, Otherwise] = {
        "retry": lambda moments, _observation: moments.option % count,
        "to_previous": lambda moments, _observation: count + moments.option % count,
        "to_start": lambda moments, _observation: np.full(len(moments), count),
        "no_recovery": lambda moments, _observation: np.full(len(moments), FINISH),
    }
    return Playbook((*nominal, *moves), policy.choose(otherwise[strategy], no_progress=strategy != "no_recovery"))


def _recoveries(
    policy: _Policy,
    nominal: Sequence[Option],
    timing: Timing,
    rng: np.random.Generator,
    modes: ModeClassifier,
    skills: Skills,
    *,
    no_progress: bool,
) -> Playbook:
    task, graph, executions = policy.task, policy.graph, _Executions(policy.graph.q.shape)
    order = rng.random(graph.q.shape)
    option = np.full(graph.q.shape, FINISH)
    recoveries: list[Option] = []
    for mode, target in np.argwhere(graph.q > 0.0).tolist():
        option[mode, target] = len(nominal) + len(recoveries)
        plan = _recovery(task, skills[mode, target], target)
        recoveries.append(relative(f"recovery_{mode}_{task.targets[target]}", plan, timing))

    def recover(moments: Moments, observation: Observation) -> IntArray:
        mode = modes.classify(observation)[0]
        target = best_recovery(graph, mode, executions.before(moments.episode)[np.arange(len(mode)), mode], order)
        feasible = target != NONE
        executions.count(moments.episode[feasible], mode[feasible], target[feasible])
        return np.where(feasible, option[mode, target], FINISH)

    return Playbook((*nominal, *recoveries), policy.choose(recover, no_progress=no_progress))


class _Executions:
    """How often each recovery was executed in each episode of a run.

    Args:
        shape: I modes, M targets.
    """

    def __init__(self, shape: tuple[int, ...]) -> None:
        self._counts = np.zeros((0, *shape), dtype=np.int64)

    def before(self, episode: IntArray) -> IntArray:
        """[N, I, M] of episodes [N]."""
        more = int(episode.max(initial=-1)) + 1 - len(self._counts)
        if more > 0:
            self._counts = np.concatenate([self._counts, np.zeros((more, *self._counts.shape[1:]), dtype=np.int64)])
        return np.asarray(self._counts[episode])

    def count(self, episode: IntArray, mode: IntArray, target: IntArray) -> None:
        """Once more; each episode [N] is named at most once."""
        self._counts[episode, mode, target] += 1


def _straight(task: RecoveryTask, target: int) -> Plan:
    return lambda observation: task.straight(observation, target)


def _recovery(task: RecoveryTask, skill: ParameterisedSkill, target: int) -> Plan:
    return lambda observation: task.recovery(skill, target, observation)
