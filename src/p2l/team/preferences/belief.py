"""Beliefs about a cost: where they come from, what a person may answer, and what is believed then.

A distribution becomes K points of equal probability, each the mean of its part of it. So the mean is the
distribution's, and what a question is worth is never overstated: to hear the part is to hear less than the cost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import special

from p2l.errors import ConfigError
from p2l.records import Array
from p2l.team.costs import LARGEST
from p2l.team.preferences.record import CostPrior, Kinds, Preferences
from p2l.team.shop import Shop

POINTS = 7  # of a distribution
MOST_POINTS = 1000  # of a belief; there is a plan for each, and a table of each pair
_SAME = 1e-9  # relative difference up to which two costs are one


def listed_prior(cost: Sequence[float], probability: Sequence[float]) -> CostPrior:
    """A belief of costs as a person lists them, in any order; those of probability 0 are left out.

    Raises:
        ShapeError: as `CostPrior`.
    """
    order = [at for at in np.argsort(cost, kind="stable").tolist() if probability[at] != 0.0]
    return CostPrior(np.array([cost[at] for at in order]), np.array([probability[at] for at in order]))


def lognormal_prior(mean: float, sd: float, points: int = POINTS) -> CostPrior:
    """A lognormal belief; `sd` 0 is certainty.

    Raises:
        ConfigError: a mean or a standard deviation below 0, the latter without a mean; no points, or too many.
    """
    if _is_certain(mean, sd, points):
        return CostPrior(np.array([mean]), np.ones(1), closed=False)
    scale = np.sqrt(np.log1p((sd / mean) ** 2))
    edges = special.ndtri(np.linspace(0.0, 1.0, points + 1))
    return _of_parts(mean, np.diff(special.ndtr(edges - scale)))


def gamma_prior(mean: float, sd: float, points: int = POINTS) -> CostPrior:
    """A gamma belief; `sd` 0 is certainty.

    Raises:
        ConfigError: as `lognormal_prior`.
    """
    if _is_certain(mean, sd, points):
        return CostPrior(np.array([mean]), np.ones(1), closed=False)
    shape = (mean / sd) ** 2
    edges = special.gammaincinv(shape, np.linspace(0.0, 1.0, points + 1))
    return _of_parts(mean, np.diff(special.gammainc(shape + 1.0, edges)))


def possible_answers(preferences: Preferences, family: int) -> tuple[Array, tuple[Preferences, ...]]:
    """[A] probability of each answer, and what is believed after each; means average to those of today.

    With noise an answer counts as the cost that it is nearest to.
    """
    prior = preferences.prior[family]
    chance = prior.probability @ _channel(prior, preferences.noise)
    heard = np.flatnonzero(chance > 0.0)
    return chance[heard], tuple(_heard(preferences, family, at, None) for at in heard.tolist())


def after_answer(preferences: Preferences, family: int, answer: float) -> Preferences:
    """What is believed after an answer.

    An exact answer is the cost from then on; where the belief is `closed` it has to be one of its costs. One with noise
    counts as the cost that it is nearest to.

    Raises:
        ConfigError: an answer that is no cost, or that a closed belief rules out.
    """
    prior, name = preferences.prior[family], preferences.families[family]
    if not 0.0 <= answer <= LARGEST:
        raise ConfigError(f"'{name}': {answer:g} is no cost; give a number from 0 to {LARGEST:g}")
    nearest = int(np.where(prior.probability > 0.0, np.abs(prior.cost - answer), np.inf).argmin())
    if preferences.noise == 0.0:
        if prior.closed and not np.isclose(prior.cost[nearest], answer, rtol=_SAME, atol=0.0):
            costs = ", ".join(f"{cost:g}" for cost in prior.cost[prior.probability > 0.0][:8].tolist())
            raise ConfigError(f"'{name}': {answer:g} is none of the costs that the prior allows ({costs})")
        return _heard(preferences, family, nearest, None if prior.closed else answer)
    return _heard(preferences, family, nearest, None)


def priced(shop: Shop, preferences: Preferences, cost: Array) -> Shop:
    """The shop with costs [F] of the families for c_hum; what the person cannot do stays so."""
    is_open = (preferences.member >= 0) & np.isfinite(shop.c_hum)
    of_family = cost[np.maximum(preferences.member, 0)] if len(cost) else shop.c_hum
    return replace(shop, c_hum=np.where(is_open, of_family, shop.c_hum))


def expected_shop(shop: Shop, preferences: Preferences) -> Shop:
    """The shop at the mean of what is believed.

    The cost of a plan is linear in c_hum, so that its expectation is its cost here, and the best plan of this shop is
    the plan of least expected cost: nothing is lost by planning for the mean until somebody is asked.
    """
    return priced(shop, preferences, preferences.mean)


def _is_certain(mean: float, sd: float, points: int) -> bool:
    if not 0.0 <= mean <= LARGEST or not 0.0 <= sd <= LARGEST or (mean == 0.0 < sd):
        raise ConfigError(f"mean {mean:g} with sd {sd:g}; a cost is at least 0, and one whose mean is 0 has no spread")
    if not 1 <= points <= MOST_POINTS:
        raise ConfigError(f"points: {points} given; expected 1 to {MOST_POINTS}")
    return sd == 0.0


def _of_parts(mean: float, share: Array) -> CostPrior:
    """Of K parts of equal probability, and what share of the mean comes from each; equal ones are one point."""
    cost = mean * len(share) * np.maximum(share, 0.0) / share.sum()
    distinct, count = np.unique(cost, return_counts=True)
    return CostPrior(distinct, count / len(cost), closed=False)


def _heard(preferences: Preferences, family: int, at: int, exact: float | None) -> Preferences:
    """What is believed after an answer that is nearest to cost `at`; `exact` is the cost, if it is another than that.

    With kinds: Bayes' rule for the kind, then each family as the kinds come to.
    """
    prior, kinds = preferences.prior[family], preferences.kinds
    told = _channel(prior, preferences.noise)[:, at]  # [K] probability of this answer by cost
    beliefs, common = list(preferences.prior), None
    if kinds is not None and (likely := kinds.weight * (kinds.given[family] @ told)).sum() > 0.0:
        weight, given = likely / likely.sum(), list(kinds.given)
        joint = kinds.given[family] * told
        total = joint.sum(axis=1, keepdims=True)
        given[family] = np.where(total > 0.0, joint / np.where(total > 0.0, total, 1.0), told / told.sum())
        if exact is not None:
            given[family] = np.ones((len(weight), 1))
        for other, each in enumerate(given):
            beliefs[other] = replace(beliefs[other], probability=_proper(weight @ each)) if other != family else prior
        common = Kinds(weight, tuple(given))
    chance = _proper(prior.probability * told) if common is None else common.weight @ common.given[family]
    if exact is not None:
        beliefs[family] = replace(prior, cost=np.array([exact]), probability=np.ones(1))
    else:
        beliefs[family] = replace(prior, probability=_proper(chance))
    return replace(preferences, prior=tuple(beliefs), kinds=common)


def _proper(weight: Array) -> Array:
    return np.asarray(weight / weight.sum())


def _channel(prior: CostPrior, noise: float) -> Array:
    """[K, K] probability that an answer is nearest to a cost (last axis), by the true one; normal errors."""
    if noise == 0.0:
        return np.eye(len(prior.cost))
    edges = np.concatenate([[-np.inf], (prior.cost[1:] + prior.cost[:-1]) / 2.0, [np.inf]])
    return np.asarray(np.diff(special.ndtr((edges[None] - prior.cost[:, None]) / noise), axis=1))
