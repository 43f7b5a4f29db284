"""How far a plan for sampled scenarios can be from the best one for the distribution behind them.

The estimator of multiple replications (Mak, Morton and Wood, Operations Research Letters 24, 1999): the plan and the
best plan of a fresh sample are compared on that sample, again and again. What the plan costs there minus what the best
one costs is, on average, no less than the plan's true distance from the optimum, so an upper limit of the mean is one
of the distance. Using the same sample for both takes most of the noise out.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from p2l.errors import ConfigError, ShapeError, SolverError
from p2l.records import Array, freeze
from p2l.team.tomorrow.forecast import Forecast, sample_counts, with_counts
from p2l.team.tomorrow.planner import plan_two_stage, recourse
from p2l.team.tomorrow.record import TwoStage, TwoStagePlan

LEVEL = 0.95


@dataclass(frozen=True)
class GapInterval:
    """Distance of a plan from the best one, in the unit of costs.

    Attributes:
        mean: over the replications, at least 0.
        upper: one-sided confidence limit; NaN for fewer than two replications.
        level: its confidence.
        replications: how many there are.
    """

    mean: float
    upper: float
    level: float
    replications: int


@dataclass(frozen=True)
class Replications:
    """A plan and the best plan on M samples.

    Attributes:
        tomorrow: [M] mean cost of tomorrow after the plan's lessons.
        cost: [M] the same with today's cost.
        bound: [M] what no plan costs less than on that sample.
    """

    tomorrow: Array
    cost: Array
    bound: Array


@dataclass(frozen=True)
class Estimate:
    """What samples say of a plan: tomorrow's mean cost, its two-sided limits at 95 %, and the optimality gap.

    `fresh` is whether they are new draws of a forecast; parts of a table of scenarios are not.
    """

    tomorrow: float
    low: float
    high: float
    gap: GapInterval
    fresh: bool


def gap_interval(cost: Array, bound: Array, level: float = LEVEL) -> GapInterval:
    """One-sided Student's t limit of the optimality gap.

    Args:
        cost: [M] what the plan costs on each of M independent samples.
        bound: [M] what no plan costs less than on the same sample.
        level: confidence.

    Raises:
        ShapeError: not as many costs as bounds, NaN, no replication, a level outside (0, 1).

    Example:
        Two gaps, 1 and 3: the mean is 2, its standard error 1, and t with one degree of freedom 6.31.

        >>> from p2l.team.tomorrow import gap_interval
        >>> limit = gap_interval([11.0, 13.0], [10.0, 10.0])
        >>> limit.mean, round(limit.upper, 2)
        (2.0, 8.31)
    """
    sizes: dict[str, int] = {}
    gaps = freeze("cost", cost, ("M",), sizes) - freeze("bound", bound, ("M",), sizes)
    if not len(gaps) or not 0.0 < level < 1.0:
        raise ShapeError(f"gap_interval: {len(gaps)} replications at level {level} given; expected some, in (0, 1)")
    mean = max(0.0, float(gaps.mean()))
    return GapInterval(mean, mean + _half(gaps, level), level, len(gaps))


def mean_interval(values: Array, level: float = LEVEL) -> tuple[float, float, float]:
    """Mean of [M] values, and its two-sided Student's t limits; NaN for one."""
    mean, half = float(np.mean(values)), _half(np.asarray(values), 0.5 + level / 2)
    return mean, mean - half, mean + half


def _half(values: Array, quantile: float) -> float:
    from scipy.stats import t

    if len(values) < 2:
        return math.nan
    return float(t.ppf(quantile, len(values) - 1) * values.std(ddof=1) / math.sqrt(len(values)))


def fresh_samples(
    program: TwoStage, forecast: Forecast, samples: int, streams: Iterable[np.random.Generator]
) -> Iterator[TwoStage]:
    """The program with other scenarios, as many as it was planned on; types of the forecast are the program's."""
    for rng in streams:
        yield with_counts(program, sample_counts(forecast, samples, rng))


def subsamples(program: TwoStage, replications: int, rng: np.random.Generator) -> Iterator[TwoStage]:
    """Parts of the program's own scenarios, each scenario in one of them: for files, whose distribution is not known.

    Nothing is drawn twice, so this is no bootstrap: M parts of S / M scenarios that come by chance. Two things make the
    limit differ from that of fresh samples. The plan was made with the same scenarios, which makes it look better; and
    the best plan of a small part fits it better than that of a large sample, which makes the plan look worse.

    Raises:
        ConfigError: fewer than two scenarios for each part.
    """
    if program.scenarios < 2 * replications:
        raise ConfigError(
            f"replications={replications}: needs at least {2 * replications} scenarios, and there are "
            f"{program.scenarios}; give fewer, or 0"
        )
    order = rng.permutation(program.scenarios)
    for part in range(replications):
        rows = np.sort(order[part::replications])
        chance = program.probability[rows]
        yield replace(program, counts=program.counts[rows], probability=chance / chance.sum())


def estimate(replications: Replications, *, fresh: bool) -> Estimate | None:
    """What replications say; None if there are none."""
    if not len(replications.cost):
        return None
    limits = mean_interval(replications.tomorrow)
    return Estimate(*limits, gap_interval(replications.cost, replications.bound), fresh)


def replicate(
    plan: TwoStagePlan, samples: Iterable[TwoStage], *, time_limit_s: float = 60.0, gap: float = 1e-3
) -> Replications:
    """Compare a plan with the best one of each sample.

    Args:
        plan: of which only today's lessons and cost are looked at.
        samples: the same today, with other scenarios.
        time_limit_s: wall seconds for all; what has not begun by then is left out.
        gap: relative gap to which the best plan of a sample is known; what it leaves counts against the plan.
    """
    deadline = time.perf_counter() + time_limit_s
    rows: list[tuple[float, float]] = []
    for sample in samples:
        if (left := deadline - time.perf_counter()) <= 0.0:
            break
        try:
            best = plan_two_stage(sample, time_limit_s=left, gap=gap)
        except SolverError:  # no time for any plan
            break
        _, cost = recourse(sample, plan.taught, deadline=deadline)
        rows.append((float(sample.probability @ cost), best.lower_bound))
    tomorrow, bound = np.array(rows).reshape(-1, 2).T
    return Replications(tomorrow, plan.today.objective + tomorrow, bound)
