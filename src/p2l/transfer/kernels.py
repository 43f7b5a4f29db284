"""Covariances of pairs: what makes two pairs of tasks alike. See `p2l.transfer.processes` for how they are used.

Both hold a constant of deviation 1, since the stated priors that are the mean may be off as a whole.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from p2l.records import Array
from p2l.transfer.few_trials import TaskPairs
from p2l.transfer.processes import Kernel

_OFFSET = 1.5  # variance of the constant, of a logit
_OWN = (-0.4, 0.4)  # log deviation of a pair's own effect: centre (0.67 of a logit) and spread of its prior


def linear_kernel(features: int, same: int) -> Kernel:
    """Bayesian logistic regression on sizes and signed values of differences and on what is the same.

    θ: log deviations of the weights of the sizes, of the signed differences, of the indicators, and of own effects.
    """
    blocks = np.repeat([0, 1, 2], [features, features, same])

    def weights(theta: Array) -> Array:
        return np.exp(2.0 * theta[:3])[blocks]

    def value(theta: Array, query: TaskPairs, tried: TaskPairs) -> Array:
        return _OFFSET + (query.linear * weights(theta)) @ tried.linear.T

    def diagonal(theta: Array, query: TaskPairs) -> Array:
        return _OFFSET + query.linear**2 @ weights(theta)

    def slopes(theta: Array, tried: TaskPairs) -> Sequence[Array]:
        x, w = tried.linear, weights(theta)
        return [2.0 * (x[:, blocks == each] * w[blocks == each]) @ x[:, blocks == each].T for each in range(3)]

    centre = np.array([-0.1, -0.7, 0.2, _OWN[0]])
    return Kernel(centre, np.array([0.5, 0.5, 0.5, _OWN[1]]), value, diagonal, slopes)


def smooth_kernel(features: int, same: int) -> Kernel:
    """Squared exponential of how two pairs differ, each feature with a weight of its own.

    Pairs are alike if their differences have like sizes; the sign counts for a share a of that, the same for all
    features. θ: log deviation of the process, log weights of F features and C indicators, log a, log own effect.
    """

    def parts(query: TaskPairs, tried: TaskPairs, a: float) -> tuple[Array, Array]:
        """Squared distances [F + C, Q, N] and what of them is due to a [F, Q, N]."""
        sizes = (query.size.T[:, :, None] - tried.size.T[:, None, :]) ** 2
        signed = a * (query.signed.T[:, :, None] - tried.signed.T[:, None, :]) ** 2
        alike = (query.same.T[:, :, None] - tried.same.T[:, None, :]) ** 2
        return np.concatenate([sizes + signed, alike]), signed

    def value(theta: Array, query: TaskPairs, tried: TaskPairs) -> Array:
        """Without the parts, by products of matrices: there may be thousands of pairs."""
        a, w = np.exp(theta[-2]), np.exp(theta[1 : 1 + features + same])
        scale = np.sqrt(np.concatenate([w[:features], a * w[:features], w[features:]]))
        x, y = query.differences * scale, tried.differences * scale
        distance = (x**2).sum(axis=1)[:, None] + (y**2).sum(axis=1) - 2.0 * x @ y.T
        return np.asarray(_OFFSET + np.exp(2.0 * theta[0] - 0.5 * np.maximum(distance, 0.0)))

    def diagonal(theta: Array, query: TaskPairs) -> Array:
        return np.full(len(query), _OFFSET + np.exp(2.0 * theta[0]))

    def slopes(theta: Array, tried: TaskPairs) -> Sequence[Array]:
        w = np.exp(theta[1 : 1 + features + same])
        distances, signed = parts(tried, tried, float(np.exp(theta[-2])))
        process = value(theta, tried, tried) - _OFFSET
        by_weight = [-0.5 * each * process * distance for each, distance in zip(w, distances, strict=True)]
        by_sign = -0.5 * process * np.tensordot(w[:features], signed, axes=1)
        return [2.0 * process, *by_weight, by_sign]

    weight = -np.log(max(1.0, 0.7 * features))
    centre = np.concatenate([[0.8], np.full(features, weight), np.full(same, -0.7), [-1.2, _OWN[0]]])
    spread = np.concatenate([[0.5], np.full(features, 1.0), np.full(same, 0.7), [0.7, _OWN[1]]])
    return Kernel(centre, spread, value, diagonal, slopes)
