"""From features and a few trials to a table of transfer probabilities ρ_ij (thesis, section 3.3.2), with intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import special

from p2l.records import Array, IntArray
from p2l.transfer.beliefs import Belief, LatentBelief
from p2l.transfer.few_trials import TaskPairs, Trials, all_pairs, pairs_of
from p2l.transfer.pair_models import ENSEMBLES, MODELS, FitSetting, own_counts
from p2l.transfer.validation import Correction, ModelChoice, Report, choose

_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(31)
_NAMED = 3  # trials that are named for a pair


@dataclass(frozen=True)
class Prediction:
    """A transfer table with what it rests on; pairs are all M · M, the tested task fastest.

    Attributes:
        names: M task names.
        choice: which model, and why.
        belief: of the pairs.
        low, high: [M, M] ends of the intervals.
        trials, successes: [M, M] counts.
        support: [M · M, S] rows of `tried` that speak most of each pair, -1 where there are fewer.
        tried: the trials.
    """

    names: tuple[str, ...]
    choice: ModelChoice
    belief: Belief
    low: Array
    high: Array
    trials: IntArray
    successes: IntArray
    support: IntArray
    tried: Trials

    @cached_property
    def p(self) -> Array:
        """[M, M] expected success probability."""
        return self.belief.mean.reshape(self.low.shape)


def predict(
    setting: FitSetting,
    trials: Trials,
    models: Sequence[str],
    folds: int,
    fewest: int,
    level: float,
    *,
    rng: np.random.Generator,
    report: Report | None = None,
) -> Prediction:
    """Choose a model, fit it to all trials and ask it about every pair.

    Args:
        setting: tasks and prior.
        trials: what was tried.
        models: candidates, see `pair_models.MODELS`.
        folds: of tasks, for the choice.
        fewest: tried pairs below which the stated prior and rates are all.
        level: share of the probability that an interval holds.
        rng: of folds and ensembles.
        report: is told how many fits are done.
    """
    choice = choose(setting, trials, models, folds, fewest, rng, report)
    query = all_pairs(setting.tasks)
    belief = corrected(MODELS[choice.model](setting, trials, query, rng), choice, query, trials)
    m = len(setting.tasks.names)
    low, high = belief.interval(level)
    successes, attempts = own_counts(query, trials)
    return Prediction(
        names=setting.tasks.names,
        choice=choice,
        belief=belief,
        low=low.reshape(m, m),
        high=high.reshape(m, m),
        trials=attempts.reshape(m, m).astype(np.int64),
        successes=successes.reshape(m, m).astype(np.int64),
        support=_support(setting, trials, query),
        tried=trials,
    )


def summary_of(prediction: Prediction, level: float) -> dict[str, Any]:
    """Facts for `summary.json`: the model, the comparison, the correction and how much there was to go by."""
    choice, platt = prediction.choice, prediction.choice.correction.platt
    return {
        "model": choice.model,
        "reason": choice.reason,
        "scores": [asdict(score) for score in choice.scores],
        "correction": {"slope": platt.slope, "shift": platt.shift, "own_variance": choice.correction.own_variance},
        "level": level,
        "tasks": len(prediction.names),
        "pairs": int(prediction.p.size),
        "tried_pairs": len(prediction.tried),
        "trials": int(prediction.trials.sum()),
        "successes": int(prediction.successes.sum()),
        "mean_p": float(prediction.p.mean()),
        "mean_width": float((prediction.high - prediction.low).mean()),
    }


def corrected(belief: Belief, choice: ModelChoice, query: TaskPairs, trials: Trials) -> Belief:
    """A belief after Platt's correction and, for an ensemble, with effects that single pairs have of their own."""
    if not isinstance(belief, LatentBelief):
        return belief
    fixed = belief.corrected(choice.correction.platt)
    return _with_own_effects(fixed, choice.correction, query, trials) if choice.model in ENSEMBLES else fixed


def _with_own_effects(belief: LatentBelief, correction: Correction, query: TaskPairs, trials: Trials) -> LatentBelief:
    """A tried pair's own effect is what its trials say beyond the ensemble's mean; another one's is open."""
    successes, attempts = own_counts(query, trials)
    effect = np.sqrt(correction.own_variance) * _NODES[:, None]
    logit = belief.logit + effect
    weight = _WEIGHTS[:, None] * np.exp(
        successes * -np.logaddexp(0.0, -logit) - (attempts - successes) * np.logaddexp(0.0, logit)
    )
    weight /= weight.sum(axis=0)
    mean = (weight * effect).sum(axis=0)
    variance = (weight * effect**2).sum(axis=0) - mean**2
    shifted = LatentBelief(belief.logit + mean, belief.variance, belief.covariance)
    return shifted.loosened(np.maximum(variance, 1e-9))


def _support(setting: FitSetting, trials: Trials, query: TaskPairs) -> IntArray:
    """[Q, S] the trials nearest in the space of pairs, of many attempts rather than few; the pair's own first."""
    count = min(_NAMED, len(trials))
    tried = pairs_of(setting.tasks, trials.taught, trials.tested)
    scale = 1.0 / np.sqrt(max(1, query.signed.shape[1]))
    x, y = (np.hstack([pairs.size * scale, 0.5 * pairs.signed * scale, pairs.same]) for pairs in (query, tried))
    near = (x**2).sum(axis=1)[:, None] + (y**2).sum(axis=1) - 2.0 * x @ y.T
    shared = (query.taught[:, None] == tried.taught).astype(np.float64) + (query.tested[:, None] == tried.tested)
    weight = special.xlogy(0.5, trials.attempts) - np.maximum(near, 0.0) + 0.5 * shared
    weight += 1e3 * (shared == 2)
    return np.argsort(-weight, axis=1, kind="stable")[:, :count]
