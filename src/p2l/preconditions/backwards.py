"""Precondition chaining: learn where skills may start, backwards from the goal (thesis, Algorithm 2).

1. Nominal executions with exact state give successful trajectories; D_i⁺ is a Gaussian over the starts of skill i.
2. For the last skill first: states in the vicinity of D_i⁺ (see `vicinity`), the skill executed from each with exact
   state, labelled by whether the next precondition holds where it ends (the goal's for the last skill).
3. A generative classifier of these samples and the good starts S_i⁺ is ρ_i, and labels the skill before.

Deviation from the thesis, where it is asked for (`ChainingOptions.error`): a robot evaluates ρ on its estimate, and
where that is never exact, a classifier of true states calls most good ones lost. With an error the samples that ρ is
fitted to are as the robot would see them, a few draws of each; labels stay those of the truth, and so do D_i⁺.

Axis letters: N samples, D state columns, K skills.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from p2l.contracts.option import Option
from p2l.contracts.rows import Rows
from p2l.contracts.symbols import Symbols
from p2l.contracts.world import World
from p2l.errors import ConfigError
from p2l.preconditions.classifier import PreconditionClassifier, fit_classifier
from p2l.preconditions.mixture import Mixture, fit_gaussian, standardisation
from p2l.preconditions.record import Preconditions
from p2l.preconditions.vicinity import Vicinity, moment_pool, sample
from p2l.records import Array, BoolArray, IntArray
from p2l.seeding import generator
from p2l.skills import chain
from p2l.skills.execute import without_noise
from p2l.skills.relative import Timing


@dataclass(frozen=True)
class ChainingOptions:
    """Budgets of Algorithm 2.

    Attributes:
        trajectories: nominal executions with exact state.
        samples: for each skill, in its vicinity.
        components: largest number of Gaussians in D_i⁻.
        regularisation: added to the variances of standardised features. 0.1 lets no direction of D_i⁺ be narrower than
            a third of how far samples spread. On the door's held-out samples that is as accurate as 0.03; it leaves
            REPS a slope that it can climb, and room for levers of another thickness.
        held_out: share of each skill's samples that only tests it, in (0, 1).
        error: how wrong the states are that classifiers are fitted to, in multiples of the estimator's first error.
        draws: of that error, for each sample; one without an error.
        vicinity: how far samples reach.
        timing: of the motions that reach them.
    """

    trajectories: int
    samples: int
    components: int = 5
    regularisation: float = 0.1
    held_out: float = 0.25
    error: float = 0.0
    draws: int = 4
    vicinity: Vicinity = field(default_factory=Vicinity)
    timing: Timing = field(default_factory=Timing)

    def __post_init__(self) -> None:
        if self.trajectories < 4 or self.samples < 8 or not 0.0 < self.held_out < 1.0:
            raise ConfigError(
                f"precondition chaining: {self.trajectories} trajectories, {self.samples} samples, share "
                f"{self.held_out} held out; expected at least 4, at least 8, and a share strictly between 0 and 1"
            )
        if not (np.isfinite(self.error) and self.error >= 0.0 and self.draws >= 1):
            raise ConfigError(
                f"precondition chaining: error {self.error}, {self.draws} draws given; expected at least 0 and 1"
            )


@dataclass(frozen=True)
class Samples:
    """Executions of one skill and of the chain after it.

    Attributes:
        states: [N, D] starts.
        ends: [N, D] where the skill ended.
        labels: [N] whether it led to the next precondition.
        solved: [N] whether the chain from this skill on led to the goal, the real thing that labels stand for.
        moved: [N] whether the start was reached by a motion of the hand, see `vicinity`.
        held_out: [N] whether the sample is for tests only.
    """

    states: Array
    ends: Array
    labels: BoolArray
    solved: BoolArray
    moved: BoolArray
    held_out: BoolArray


@dataclass(frozen=True)
class Chaining:
    """Preconditions, and the executions that they were fitted to.

    Attributes:
        preconditions: the record.
        samples: K, in the order of the skills.
        good: K sets of states [·, D] from which successful nominal executions started each skill, the S_i⁺.
        trajectories: nominal executions, and
        successful: those that reached the goal.
    """

    preconditions: Preconditions
    samples: tuple[Samples, ...]
    good: tuple[Array, ...]
    trajectories: int
    successful: int

    def sample_arrays(self) -> dict[str, npt.NDArray[Any]]:
        """All samples as `<skill>.<field>`, for `artifacts.save_arrays`."""
        return {
            f"{name}.{each.name}": getattr(samples, each.name)
            for name, samples in zip(self.preconditions.names, self.samples, strict=True)
            for each in fields(samples)
        }


def chain_preconditions(
    world: World,
    symbols: Symbols,
    nominal: Sequence[Option],
    options: ChainingOptions,
    seed: int,
    progress: Callable[[int], None] | None = None,
) -> Chaining:
    """Learn the preconditions of `nominal`, in order.

    Args:
        world: with an estimator that errs, for samples in the vicinity.
        symbols: describes it.
        nominal: the chain.
        options: budgets.
        seed: of everything.
        progress: called with the number of skills finished since the last call.

    Raises:
        ConfigError: hardly any nominal execution succeeds.
    """
    starts = world.sample(generator(seed, "preconditions", "trajectories"), options.trajectories)
    believe = _Belief(world, symbols, options, generator(seed, "preconditions", "error"))
    good_rows, successful = _good(world, nominal, without_noise(starts))
    good = [symbols.state(world.privileged(rows)) for rows in good_rows]
    seen = [believe.states(rows) for rows in good_rows]
    rng = generator(seed, "preconditions", "vicinity")
    pool = moment_pool(world, nominal, world.sample(rng, options.trajectories), options.vicinity.noise, rng)
    skills: list[PreconditionClassifier] = []
    sets: list[Samples] = []
    for skill in reversed(range(len(nominal))):
        density = _density(good[skill], good[skill], options.regularisation)
        rows, by_motion = sample(
            world, symbols, pool, skill, density, options.samples, options.vicinity, options.timing, rng
        )
        samples = _try(believe, nominal, rows, by_motion, skill, skills, rng)
        skills.insert(
            0, fit_one(symbols.names, samples, seen[skill], options, generator(seed, "preconditions", "fit", skill))
        )
        sets.insert(0, samples)
        if progress is not None:
            progress(1)
    names = tuple(option.name for option in nominal)
    rates = np.array([_precision(skill, samples) for skill, samples in zip(skills, sets, strict=True)])
    ends, labels = sets[-1].ends[:: believe.draws], sets[-1].labels[:: believe.draws]  # once each
    goal = _density(np.concatenate([ends[labels], good[-1]]), ends, options.regularisation)
    record = Preconditions(world.name, world.digest, names, tuple(skills), goal, rates)
    return Chaining(record, tuple(sets), tuple(seen[:-1]), len(starts), successful)


@dataclass(frozen=True)
class _Belief:
    """How states look to the robot.

    Args:
        world: where.
        symbols: describes it.
        options: the error and its draws.
        rng: draws them.
    """

    world: World
    symbols: Symbols
    options: ChainingOptions
    rng: np.random.Generator

    @property
    def draws(self) -> int:
        """States of each row."""
        return self.options.draws if self.options.error > 0.0 else 1

    def states(self, rows: Rows) -> Array:
        """[N · draws, D], those of a row one after the other; without an error the truth."""
        if self.options.error <= 0.0:
            return self.symbols.state(self.world.privileged(rows))
        copies = rows.take(np.repeat(np.arange(len(rows)), self.draws))
        noise = self.world.estimator.draw(self.rng, len(copies))
        error = dataclasses.replace(copies, noise=self.options.error * noise, actions=np.zeros_like(copies.actions))
        return self.symbols.state(self.world.observe(error))


def _good(world: World, nominal: Sequence[Option], starts: Rows) -> tuple[list[Rows], int]:
    """Moments of successful executions: K sets of starts of skills, then the ends; and how many there were."""
    run = chain.run(world, nominal, starts, stop_on_failure=False)
    if run.success.sum() < 4:
        raise ConfigError(
            f"world '{world.name}': {run.success.sum()} of {len(starts)} nominal executions with exact state reach "
            "the goal; at least 4 are needed to learn preconditions. Check the skills, or ask for more trajectories"
        )
    ends = run.ends.take(run.success[run.ends.episode])
    sets = [starts.take(run.success), *(ends.rows.take(ends.option == index) for index in range(len(nominal)))]
    return sets, int(run.success.sum())


def _try(
    believe: _Belief,
    nominal: Sequence[Option],
    rows: Rows,
    by_motion: BoolArray,
    skill: int,
    later: Sequence[PreconditionClassifier],
    rng: np.random.Generator,
) -> Samples:
    """Execute `skill` and all after it from `rows`; `later` are the preconditions of those after it."""
    world, symbols = believe.world, believe.symbols
    first: IntArray = np.full(len(rows), skill)
    run = chain.run(world, nominal, rows, first=first, stop_on_failure=False)
    own = run.ends.take((run.ends.option == skill) & ~run.diverged[run.ends.episode])
    ends = symbols.state(world.privileged(own.rows))
    sound = own.episode
    each = np.repeat(np.arange(len(sound)), believe.draws)
    labels = later[0].holds(ends) if later else world.goal(own.rows)
    held_out = rng.random(len(sound)) < believe.options.held_out
    return Samples(
        states=believe.states(rows.take(sound)),
        ends=ends[each],
        labels=labels[each],
        solved=run.success[sound][each],
        moved=by_motion[sound][each],
        held_out=held_out[each],
    )


def fit_one(
    names: Sequence[str], samples: Samples, good: Array, options: ChainingOptions, rng: np.random.Generator
) -> PreconditionClassifier:
    """ρ of one skill from its training samples and its good starts [·, D]."""
    training = ~samples.held_out
    states = np.concatenate([samples.states[training], good])
    labels = np.concatenate([samples.labels[training], np.ones(len(good), dtype=np.bool_)])
    return fit_classifier(
        states, labels, names, rng, components=options.components, regularisation=options.regularisation
    )


def _precision(skill: PreconditionClassifier, samples: Samples) -> float:
    """Share of held-out samples in the precondition from which the skill succeeds; Laplace's estimate."""
    inside = skill.holds(samples.states[samples.held_out])
    return float((samples.labels[samples.held_out][inside].sum() + 1.0) / (inside.sum() + 2.0))


def _density(states: Array, reference: Array, regularisation: float) -> Mixture:
    """D⁺ of good states [·, D], regularised in units of how far those of `reference` [·, D] spread."""
    mean, scale = standardisation(reference)
    return fit_gaussian((states - mean) / scale, regularisation).in_units(mean, scale)
