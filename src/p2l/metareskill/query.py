"""One query: how to recover from one failure state to one target, by REPS (thesis, section 4.4).

Facts of the author's experiments: relative-entropy bound 0.5, minimum temperature 1e-5, 10 updates of 40 rollouts,
solved at success ≥ 0.9; return of a rollout Σ over the waypoints of R, plus 5 R at the last one; first mean: the
straight motion to a sampled goal state of the target. Where a guess is named (`target.GUESSES`) it is the first mean,
to the mean of D⁺: then solutions of one mode differ by their failures alone, and not by what was sampled.

Where the facts are silent:
1. Standard deviations of the first distribution, a floor under them, and a diagonal covariance (`QueryOptions`).
   Deviation: the bound is 1 nat, since a diagonal search as wide as this one comes nowhere in 10 updates at 0.5.
2. A straight first mean leaves open, before the last waypoint, whether the fingers are open or closed.
3. A search stops after the first update whose rollouts succeed often enough, and answers with the mean that drew
   them. An unsolved one answers with its last mean; it is a failure and says so.
   With `all_updates` it makes all of them, as the author's did, and answers with the last mean; it is solved where the
   last rollouts succeed often enough.
4. A search none of whose rollouts reached the target in the first `hopeless` updates is given up: on the door no such
   search was solved later, and they took a quarter of all updates. `all_updates` gives up none.
5. A learnt precondition is a classifier, and a search finds where it errs. With `verify` a target counts as reached
   where its precondition holds and the nominal skills from there on reach the goal. It costs the simulation of these
   skills from where the precondition holds.
6. A rollout whose simulation breaks down gets the lowest return of its update.

All rollouts of an update are one batch of the engine; several queries share batches and stay independent of each
other, since each has its own generator.

Axis letters: Q queries, N rollouts of an update, P parameters, U updates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from p2l.contracts.rows import Rows
from p2l.errors import ConfigError
from p2l.metareskill.target import RecoveryTask
from p2l.records import Array, BoolArray
from p2l.skills.execute import execute, without_noise
from p2l.skills.relative import SIZE, WAYPOINTS, Timing
from p2l.skills.reps import SearchDistribution, divergence, update

LAST = 5.0  # weight of the last waypoint's reward, beside the sum over all


@dataclass(frozen=True)
class QueryOptions:
    """How REPS searches.

    Attributes:
        updates: U at most.
        rollouts: N.
        hopeless: updates without any success after which a search is given up.
        epsilon: bound on the relative entropy of an update, nats.
        minimum_temperature: of its dual.
        solved: share of an update's rollouts that reach the target, from which the query is solved.
        sigma_m: first standard deviation of each displacement, by waypoint.
        sigma_rad: of each rotation.
        sigma_grip: of each number whose sign opens or closes the fingers.
        floor: smallest standard deviations as a share of the first.
        shrinkage: 1 keeps the diagonal of covariances only, 0 all of them.
        all_updates: none is left out, whether the query is solved before or hopeless.
        verify: a target is reached where the nominal skills from there on reach the goal, too (deviation 5).
        timing: of the recovery.
    """

    updates: int = 10
    rollouts: int = 40
    hopeless: int = 5
    epsilon: float = 1.0
    minimum_temperature: float = 1e-5
    solved: float = 0.9
    sigma_m: tuple[float, ...] = (0.03, 0.03, 0.02)
    sigma_rad: float = 0.05
    sigma_grip: float = 1.0
    floor: float = 0.1
    shrinkage: float = 1.0
    all_updates: bool = False
    verify: bool = True
    timing: Timing = field(default_factory=Timing)

    def __post_init__(self) -> None:
        if min(self.updates, self.hopeless) < 1 or self.rollouts < 2 or not 0.0 < self.solved <= 1.0:
            raise ConfigError(
                f"query: {self.updates} updates of {self.rollouts} rollouts, hopeless after {self.hopeless}, solved at "
                f"{self.solved} given; expected at least 1, 2 and 1, and a share in (0, 1]"
            )
        if min(*self.sigma_m, self.sigma_rad, self.sigma_grip) <= 0.0 or not 0.0 <= self.floor <= 1.0:
            raise ConfigError("query: standard deviations must be above 0 and the floor in [0, 1]")

    @property
    def sigma(self) -> Array:
        """[P] first standard deviations."""
        legs = [[sigma] * 3 + [self.sigma_rad] * 3 + [self.sigma_grip] for sigma in self.sigma_m]
        return np.concatenate(legs)


@dataclass(frozen=True)
class QueryResult:
    """The outcome of one query.

    Attributes:
        parameters: [P] mean of the search distribution that solved it, or the last one.
        solved: whether enough rollouts reached the target.
        success: share of rollouts that did, one number per update.
        returns: mean return, likewise.
        kl_nats: by how much each update moved the search distribution, KL(new ‖ old) of the Gaussians.
        rollouts: how many were run.
    """

    parameters: Array
    solved: bool
    success: tuple[float, ...]
    returns: tuple[float, ...]
    kl_nats: tuple[float, ...]
    rollouts: int


def query(
    task: RecoveryTask,
    rows: Rows,
    targets: Sequence[int],
    rngs: Sequence[np.random.Generator],
    options: QueryOptions,
    guesses: Sequence[str] | None = None,
) -> tuple[QueryResult, ...]:
    """Search for a recovery from each of `rows` [Q] to each of `targets` [Q].

    Args:
        task: world and preconditions.
        rows: failures.
        targets: where to.
        rngs: a generator for each query.
        options: of the search.
        guesses: names of the first means; empty ones, or none at all: as the author's.
    """
    rows = without_noise(rows)
    names = guesses or [""] * len(targets)
    searches = [_first(task, rows.take([q]), target, rngs[q], options, names[q]) for q, target in enumerate(targets)]
    answers: dict[int, QueryResult] = {}
    curves: list[tuple[list[float], list[float], list[float]]] = [([], [], []) for _ in targets]
    for number in range(1, options.updates + 1):
        active = [q for q in range(len(targets)) if q not in answers]
        if not active:
            break
        samples = [searches[q].sample(rngs[q], options.rollouts) for q in active]
        returns, hits = _rollouts(task, rows, active, targets, samples, options)
        for q, sample, value, hit in zip(active, samples, returns, hits, strict=True):
            curves[q][0].append(float(hit.mean()))
            curves[q][1].append(float(value.mean()))
            solved, last = bool(hit.mean() >= options.solved), number == options.updates
            hopeless = not any(curves[q][0]) and number >= options.hopeless
            ends = last if options.all_updates else last or solved or hopeless
            if options.all_updates or not ends:
                before, searches[q] = searches[q], _update(searches[q], sample, value, options)
                curves[q][2].append(divergence(searches[q], before))
            if ends:
                success, mean, moved = (tuple(curve) for curve in curves[q])
                answers[q] = QueryResult(searches[q].mean, solved, success, mean, moved, number * options.rollouts)
    return tuple(answers[q] for q in range(len(targets)))


def _first(
    task: RecoveryTask, row: Rows, target: int, rng: np.random.Generator, options: QueryOptions, guess: str
) -> SearchDistribution:
    density = task.preconditions.density(target)
    goal = density.means[:1] if guess else density.sample(rng, 1)
    mean = task.guess(guess or "straight", task.world.privileged(row), task.world.observe(row), goal)[0]
    if guess in ("", "straight"):
        mean[6 : 7 * (WAYPOINTS - 1) : 7] = 0.0
    return SearchDistribution(mean, np.diag(options.sigma**2))


def _update(search: SearchDistribution, samples: Array, returns: Array, options: QueryOptions) -> SearchDistribution:
    return update(
        search,
        samples,
        returns,
        epsilon=options.epsilon,
        minimum_temperature=options.minimum_temperature,
        shrinkage=options.shrinkage,
        floor=(options.floor * options.sigma) ** 2,
    )


def _rollouts(
    task: RecoveryTask,
    rows: Rows,
    active: Sequence[int],
    targets: Sequence[int],
    samples: Sequence[Array],
    options: QueryOptions,
) -> tuple[list[Array], list[BoolArray]]:
    """Returns and hits of each active query's rollouts, all in one batch."""
    copies = rows.take(np.repeat(active, options.rollouts))
    arrivals = execute(task.world, copies, np.concatenate(samples).reshape(-1, SIZE), options.timing)
    returns, hits = [], []
    for place, q in enumerate(active):
        own = np.arange(place * options.rollouts, (place + 1) * options.rollouts)
        judgements = [task.judge(leg.take(own), targets[q]) for leg in arrivals.legs[:-1]]
        judgements.append(task.judge(arrivals.last.take(own), targets[q], verify=options.verify))
        value = sum((reward for reward, _ in judgements), start=LAST * judgements[-1][0])
        diverged = arrivals.diverged[own]
        value = np.where(diverged, value[~diverged].min() if not diverged.all() else 0.0, value)
        returns.append(value)
        hits.append(judgements[-1][1] & ~diverged)
    return returns, hits
