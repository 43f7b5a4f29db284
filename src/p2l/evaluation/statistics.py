"""Intervals for what is reported: rates, means, and differences of paired measurements.

What is learnt is judged by its trainings: episodes of one policy are alike, so an interval over the pooled episodes of
five trainings says nothing of a sixth. `rate_interval` and `mean_interval` are the one convention, and `TRAININGS` says
it in captions. Where nothing was trained, episodes are the samples.

Arrays are [..., S] with the S samples last; results drop that axis. Nothing is drawn without an `rng`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import numpy as np
import numpy.typing as npt
from scipy import stats

from p2l.errors import ShapeError
from p2l.records import Array

TRAININGS = (
    "95 % intervals: Student's t over the trainings where there are several, which n then counts, and for rates never "
    "narrower than Wilson's over all episodes; over episodes where there is one training, or nothing is trained."
)


@dataclass(frozen=True)
class Interval:
    """An estimate with its confidence limits; all three have the same shape. `n` samples went into each."""

    mean: Array
    low: Array
    high: Array
    n: int

    @property
    def excludes_zero(self) -> npt.NDArray[np.bool_]:
        """Whether the whole interval lies on one side of zero."""
        return np.asarray((self.low > 0) | (self.high < 0))


def wilson_interval(successes: npt.ArrayLike, trials: npt.ArrayLike, level: float = 0.95) -> tuple[Array, Array]:
    """Wilson score limits (low, high) of the rate `successes / trials`, which broadcast; no trials give [0, 1].

    Raises:
        ShapeError: negative counts, or more successes than trials.
    """
    count, total = np.broadcast_arrays(np.asarray(successes, float), np.asarray(trials, float))
    if np.any(count < 0) or np.any(count > total):
        raise ShapeError(f"successes {count.min()} to {count.max()} of {total.min()}: must lie between 0 and trials")
    z = _quantile(level)
    with np.errstate(invalid="ignore", divide="ignore"):
        rate = count / total
        centre = (rate + z**2 / (2 * total)) / (1 + z**2 / total)
        half = z / (1 + z**2 / total) * np.sqrt(rate * (1 - rate) / total + z**2 / (4 * total**2))
    none = total == 0
    # At 0 and at all successes the limit is exact; rounding must not push it off by an ulp.
    low = np.where(none | (count == 0), 0.0, np.maximum(centre - half, 0.0))
    high = np.where(none | (count == total), 1.0, np.minimum(centre + half, 1.0))
    return low, high


def t_interval(values: npt.ArrayLike, level: float = 0.95) -> Interval:
    """Mean and Student's t limits over the last axis; limits are NaN for a single sample."""
    samples = _samples(values)
    n = samples.shape[-1]
    mean = samples.mean(axis=-1)
    if n < 2:
        nothing = np.full(mean.shape, np.nan)
        return Interval(mean, nothing, nothing, n)
    half = stats.t.ppf(0.5 + level / 2, n - 1) * samples.std(axis=-1, ddof=1) / np.sqrt(n)
    return Interval(mean, mean - half, mean + half, n)


def rate_interval(successes: npt.ArrayLike, trials: npt.ArrayLike, level: float = 0.95) -> Interval:
    """Rate of something learnt, from the successes and trials [S] of its trainings; those without a trial do not count.

    Several trainings: the mean of their rates, and Student's t limits over them, within [0, 1], but never narrower than
    Wilson's over all trials, since few trainings may agree by chance; `n` counts trainings. One: Wilson's limits over
    its trials, which `n` counts. None: NaN.

    Raises:
        ShapeError: negative counts, or more successes than trials.
    """
    count, total = np.broadcast_arrays(np.asarray(successes, float), np.asarray(trials, float))
    low, high = wilson_interval(count, total, level)
    some = np.flatnonzero(total > 0)
    if len(some) > 1:
        over = t_interval(count[some] / total[some], level)
        pooled = wilson_interval(count.sum(), total.sum(), level)
        limits = np.minimum(over.low, pooled[0]), np.maximum(over.high, pooled[1])
        return Interval(over.mean, np.maximum(limits[0], 0.0), np.minimum(limits[1], 1.0), over.n)
    if not len(some):
        nothing = np.asarray(np.nan)
        return Interval(nothing, nothing, nothing, 0)
    [only] = some
    return Interval(np.asarray(count[only] / total[only]), low[only], high[only], int(total[only]))


def mean_interval(groups: Sequence[npt.ArrayLike], level: float = 0.95) -> Interval:
    """Mean of something learnt, from the measurements of each training: of their means, else of the only one's.

    Raises:
        ShapeError: no training, or one that measured nothing.
    """
    if len(groups) == 1:
        return t_interval(groups[0], level)
    return t_interval([float(_samples(group).mean()) for group in groups], level)


def bootstrap_interval(
    values: npt.ArrayLike, rng: np.random.Generator, level: float = 0.95, resamples: int = 2000
) -> Interval:
    """Mean and percentile-bootstrap limits over the last axis; entries of the leading axes are resampled together."""
    samples = _samples(values)
    n = samples.shape[-1]
    means = samples @ resample_weights(n, resamples, rng).T / n  # [..., resamples]
    low, high = np.quantile(means, [0.5 - level / 2, 0.5 + level / 2], axis=-1)
    return Interval(samples.mean(axis=-1), low, high, n)


def paired_difference(
    a: npt.ArrayLike,
    b: npt.ArrayLike,
    rng: np.random.Generator | None = None,
    level: float = 0.95,
    resamples: int = 2000,
) -> Interval:
    """Mean of a − b over the last axis, where sample i of both met the same problem.

    Student's t limits without `rng`, percentile-bootstrap limits with it.

    Raises:
        ShapeError: `a` and `b` differ in shape, are empty or not finite.
    """
    first, second = _samples(a), _samples(b)
    if first.shape != second.shape:
        raise ShapeError(f"paired samples have shapes {first.shape} and {second.shape}; they must be equal")
    if rng is None:
        return t_interval(first - second, level)
    return bootstrap_interval(first - second, rng, level, resamples)


def resample_weights(n: int, resamples: int, rng: np.random.Generator) -> Array:
    """How often each of n units is drawn in each bootstrap resample: [resamples, n], rows sum to n."""
    return np.asarray(rng.multinomial(n, np.full(n, 1.0 / n), size=resamples), dtype=np.float64)


def _samples(values: npt.ArrayLike) -> Array:
    samples = np.asarray(values, dtype=np.float64)
    if samples.ndim == 0 or samples.shape[-1] == 0:
        raise ShapeError(f"samples have shape {samples.shape}; at least one sample is needed on the last axis")
    if not np.isfinite(samples).all():
        raise ShapeError("samples hold NaN or infinity; leave out what was not measured")
    return samples


def _quantile(level: float) -> float:
    if not 0 < level < 1:
        raise ShapeError(f"level {level}: a confidence level lies between 0 and 1, e.g. 0.95")
    return cast(float, stats.norm.ppf(0.5 + level / 2))
