"""What is believed of the success probabilities of Q pairs, and how one more trial would change it.

Two kinds, with one interface (`Belief`). `BetaBelief`: each pair by itself, a beta distribution; a trial changes its
own pair alone, exactly. `LatentBelief`: logits are jointly normal, so that a trial of one pair moves the pairs that
resemble it. Expectations over a normal logit are taken by Gauss and Hermite's quadrature.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.polynomial.hermite_e import hermegauss
from scipy import special, stats

from p2l.records import Array, IntArray
from p2l.transfer.calibration import Platt

_OUTER, _INNER = 31, 9  # nodes for the pair that is tried, and for what is left open of another one


def _nodes(count: int) -> tuple[Array, Array]:
    """Nodes and weights [count] of an expectation over a standard normal variable."""
    nodes, weights = hermegauss(count)
    return nodes, weights / weights.sum()


_X, _WX = _nodes(_OUTER)
_Z, _WZ = _nodes(_INNER)


class Belief(Protocol):
    """Success probabilities of Q pairs, of which nothing is certain."""

    @property
    def mean(self) -> Array:
        """[Q] expected success probability."""

    def interval(self, level: float) -> tuple[Array, Array]:
        """Ends [Q], [Q] of the central interval that holds the probability with this probability."""

    def outcomes(self, pair: int, attempts: int, at: IntArray) -> tuple[Array, Array]:
        """How probable each number of successes is, [k + 1], and what is then expected of pairs `at`, [k + 1, |at|]."""

    def extremes(self, pair: int, level: float, at: IntArray) -> Array:
        """[2, |at|] roughly what is expected if the pair is at the low, then at the high end of its interval."""


@dataclass(frozen=True)
class BetaBelief:
    """Independent beta distributions with these numbers [Q] of (pseudo-)successes and failures."""

    successes: Array
    failures: Array

    @property
    def mean(self) -> Array:
        """[Q] expected success probability."""
        return self.successes / (self.successes + self.failures)

    def interval(self, level: float) -> tuple[Array, Array]:
        """Ends of the central interval, [Q] each."""
        tail = 0.5 * (1.0 - level)
        low, high = (stats.beta.ppf(q, self.successes, self.failures) for q in (tail, 1.0 - tail))
        return np.asarray(low), np.asarray(high)

    def outcomes(self, pair: int, attempts: int, at: IntArray) -> tuple[Array, Array]:
        """As in `Belief`: the beta-binomial distribution, and the conjugate update of the pair itself."""
        a, b = float(self.successes[pair]), float(self.failures[pair])
        count = np.arange(attempts + 1)
        log_probability = special.betaln(a + count, b + attempts - count) - special.betaln(a, b)
        probability = special.comb(attempts, count) * np.exp(log_probability)
        means = np.tile(self.mean[at], (attempts + 1, 1))
        means[:, at == pair] = ((a + count) / (a + b + attempts))[:, None]
        return probability / probability.sum(), means

    def extremes(self, pair: int, level: float, at: IntArray) -> Array:
        """As in `Belief`."""
        tail = 0.5 * (1.0 - level)
        ends = np.asarray(stats.beta.ppf([tail, 1.0 - tail], self.successes[pair], self.failures[pair]))
        return np.where(at == pair, ends[:, None], self.mean[at])


@dataclass(frozen=True)
class LatentBelief:
    """Jointly normal logits.

    Attributes:
        logit: [Q] their means.
        variance: [Q] their variances.
        covariance: of one pair with all, [Q] for its number; its own entry is its variance.
    """

    logit: Array
    variance: Array
    covariance: Callable[[int], Array]

    @cached_property
    def mean(self) -> Array:
        """[Q] expected success probability."""
        return np.asarray(expected_success(self.logit, self.variance))

    def interval(self, level: float) -> tuple[Array, Array]:
        """Ends of the central interval, [Q] each."""
        reach = float(special.ndtri(0.5 + 0.5 * level)) * np.sqrt(self.variance)
        return special.expit(self.logit - reach), special.expit(self.logit + reach)

    def outcomes(self, pair: int, attempts: int, at: IntArray) -> tuple[Array, Array]:
        """As in `Belief`: given the logit of the tried pair, which outcomes weigh, all others are normal."""
        deviation = np.sqrt(self.variance[pair])
        node = self.logit[pair] + deviation * _X
        p = special.expit(node)
        slope = self.covariance(pair)[at] / max(float(self.variance[pair]), 1e-12)
        rest = np.maximum(self.variance[at] - slope**2 * self.variance[pair], 0.0)
        rest[at == pair] = 0.0
        given = expected_success(self.logit[at] + slope * deviation * _X[:, None], rest)  # [nodes, |at|]
        count = np.arange(attempts + 1)[:, None]
        joint = _WX * special.comb(attempts, count) * p**count * (1.0 - p) ** (attempts - count)
        probability = joint.sum(axis=1)
        return probability / probability.sum(), joint @ given / probability[:, None]

    def extremes(self, pair: int, level: float, at: IntArray) -> Array:
        """As in `Belief`, with MacKay's approximation of the expectation, which is quick and right to some percent."""
        reach = float(special.ndtri(0.5 + 0.5 * level)) * np.array([[-1.0], [1.0]])
        slope = self.covariance(pair)[at] / np.sqrt(max(float(self.variance[pair]), 1e-12))
        rest = np.maximum(self.variance[at] - slope**2, 0.0)
        return np.asarray(special.expit((self.logit[at] + slope * reach) / np.sqrt(1.0 + 0.125 * np.pi * rest)))

    def corrected(self, platt: Platt) -> LatentBelief:
        """The same after Platt's correction, which keeps normal logits normal."""
        covariance = self.covariance
        return LatentBelief(
            logit=platt.slope * self.logit + platt.shift,
            variance=platt.slope**2 * self.variance,
            covariance=lambda pair: platt.slope**2 * covariance(pair),
        )

    def loosened(self, variance: Array | float) -> LatentBelief:
        """The same with a normal effect of each pair's own added, [Q] variances."""
        covariance, more = self.covariance, np.broadcast_to(variance, self.logit.shape)

        def total(pair: int) -> Array:
            row = covariance(pair).copy()
            row[pair] += more[pair]
            return row

        return replace(self, variance=self.variance + more, covariance=total)


def expected_success(logit: Array, variance: Array) -> Array:
    """Expectation of the success probability under normal logits, by quadrature; shapes broadcast."""
    deviation = np.sqrt(variance)
    total = np.zeros(np.broadcast_shapes(np.shape(logit), np.shape(deviation)))
    for z, weight in zip(_Z.tolist(), _WZ.tolist(), strict=True):
        total += weight * special.expit(logit + z * deviation)
    return total
