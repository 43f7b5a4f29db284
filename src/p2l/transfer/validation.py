"""Which model predicts tasks that it has not met: cross-validation over tasks, and a correction by what it got wrong.

A fold's tasks are held out as taught and as tested tasks: a model is fitted to the trials between the other tasks and
judged on the trials that meet a held-out one. Scores are log losses per trial, in nats.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import optimize, special, stats

from p2l.records import Array, IntArray
from p2l.transfer.beliefs import LatentBelief, expected_success
from p2l.transfer.calibration import EPSILON, Platt
from p2l.transfer.few_trials import Trials, pairs_of
from p2l.transfer.pair_models import ENSEMBLES, MODELS, FitSetting

BASELINE = "rates"
_ENOUGH = 40  # trials, a quarter of them of each outcome, from which a correction is fitted
_MEMBERS = 20  # of an ensemble while models are compared
_RIDGE = 2.0  # of a correction's parameters, in nats: it stays near the identity unless trials say otherwise
_OWN_VARIANCE = 1.0  # of a logit: what is believed of the effect that a pair has of its own
_NODES, _WEIGHTS = np.polynomial.hermite_e.hermegauss(15)

Report = Callable[[int, int], None]  # steps done, of how many


@dataclass(frozen=True)
class Score:
    """How well a model predicts held-out tasks.

    Attributes:
        model: its name.
        losses: one per fold, nats per trial.
        corrected: whether Platt's correction is part of it.
        loss, low, high: mean over all trials, and its 90 % interval over folds (Student's t).
        gain, gain_low, gain_high: the baseline's loss minus this one, paired by fold, and its interval.
    """

    model: str
    losses: tuple[float, ...]
    corrected: bool
    loss: float
    low: float
    high: float
    gain: float = 0.0
    gain_low: float = 0.0
    gain_high: float = 0.0


@dataclass(frozen=True)
class Correction:
    """Platt's correction of a model's logits, and the variance of the effect that each pair has of its own."""

    platt: Platt = field(default_factory=Platt)
    own_variance: float = 0.0


@dataclass(frozen=True)
class ModelChoice:
    """What was chosen, and why.

    Attributes:
        model: its name.
        correction: of its logits.
        scores: of all candidates, the best first; none if there were too few trials to compare.
        reason: one sentence.
    """

    model: str
    correction: Correction
    scores: tuple[Score, ...]
    reason: str


@dataclass(frozen=True)
class _Held:
    """Predictions for trials that were held out: logits and their variances, counts and fold, [H] each."""

    logit: Array
    variance: Array
    successes: IntArray
    attempts: IntArray
    fold: IntArray

    def take(self, rows: Array) -> _Held:
        return _Held(self.logit[rows], self.variance[rows], self.successes[rows], self.attempts[rows], self.fold[rows])

    def losses(self, p: Array) -> Array:
        """[H] nats of all attempts of each pair."""
        q = np.clip(p, EPSILON, 1.0 - EPSILON)
        return -self.successes * np.log(q) - (self.attempts - self.successes) * np.log1p(-q)


def deal_folds(setting: FitSetting, folds: int, rng: np.random.Generator) -> IntArray:
    """[M] fold of each task, families spread evenly over them."""
    m = len(setting.tasks.names)
    family = np.zeros(m, dtype=np.int64) if setting.tasks.family is None else setting.tasks.family
    order = np.lexsort((rng.random(m), family))
    fold = np.empty(m, dtype=np.int64)
    fold[order] = (np.arange(m) + rng.integers(folds)) % folds
    return fold


def choose(
    setting: FitSetting,
    trials: Trials,
    models: Sequence[str],
    folds: int,
    fewest: int,
    rng: np.random.Generator,
    report: Report | None = None,
) -> ModelChoice:
    """The model of the smallest log loss on held-out tasks; the baseline where trials are too few to tell.

    An ensemble, whose intervals are less honest than a posterior's, has to be better by more than a standard error.

    Args:
        setting: tasks and prior.
        trials: all of them.
        models: names of candidates; the baseline is always one.
        folds: of tasks.
        fewest: tried pairs below which nothing is compared.
        rng: deals the folds and draws what ensembles need.
        report: is told how many fits are done.
    """
    split = deal_folds(setting, folds, rng)
    setting = replace(setting, members=min(setting.members, _MEMBERS))
    if why := _too_few(trials, split, folds, fewest):
        return ModelChoice(BASELINE, Correction(), (), why)
    names = list(dict.fromkeys([BASELINE, *models]))
    held: dict[str, _Held] = {}
    for turn, name in enumerate(names):
        parts = []
        for number in range(folds):
            parts.append(_hold_out(setting, trials, name, split, number, rng))
            if report is not None:
                report(turn * folds + number + 1, len(names) * folds)
        held[name] = _joined(parts)
    scores = {name: _score(name, each) for name, each in held.items()}
    base = scores[BASELINE]
    ranked = sorted((_beside(score, base, held[BASELINE]) for score in scores.values()), key=lambda each: each.loss)
    best = _winner(ranked, held[BASELINE])
    correction = _fit_correction(held[best.model], best.model, best.corrected)
    return ModelChoice(best.model, correction, tuple(ranked), _reason(best, base))


def _too_few(trials: Trials, split: IntArray, folds: int, fewest: int) -> str:
    """Why models cannot be compared; empty if they can."""
    if not len(trials):
        return "no trials: the stated prior alone"
    if len(trials) < fewest:
        return f"{len(trials)} tried pairs are fewer than {fewest}: stated prior and success rates by kind of pair"
    total, wins = int(trials.attempts.sum()), int(trials.successes.sum())
    if min(wins, total - wins) < 3:
        return "fewer than 3 trials of one outcome: stated prior and success rates by kind of pair"
    for number in range(folds):
        held = (split[trials.taught] == number) | (split[trials.tested] == number)
        if not held.any() or held.all():
            return "a fold of tasks has no trials, or all: stated prior and success rates by kind of pair"
    return ""


def _hold_out(
    setting: FitSetting, trials: Trials, name: str, split: IntArray, number: int, rng: np.random.Generator
) -> _Held:
    out = (split[trials.taught] == number) | (split[trials.tested] == number)
    judged = trials.take(np.flatnonzero(out))
    query = pairs_of(setting.tasks, judged.taught, judged.tested)
    belief = MODELS[name](setting, trials.take(np.flatnonzero(~out)), query, rng)
    if isinstance(belief, LatentBelief):
        logit, variance = belief.logit, belief.variance
    else:
        logit, variance = special.logit(np.clip(belief.mean, EPSILON, 1 - EPSILON)), np.zeros(len(query))
    return _Held(logit, variance, judged.successes, judged.attempts, np.full(len(query), number))


def _joined(parts: Sequence[_Held]) -> _Held:
    names = ("logit", "variance", "successes", "attempts", "fold")
    return _Held(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _score(name: str, held: _Held) -> Score:
    """Corrected where a correction fitted to the other folds is better."""
    plain = held.losses(expected_success(held.logit, held.variance))
    losses, corrected = plain, False
    if name != BASELINE and _enough(held):
        crossed = np.empty_like(plain)
        for number in np.unique(held.fold):
            mine = held.fold == number
            fitted = _fit_correction(held.take(~mine), name, True)
            crossed[mine] = held.take(mine).losses(_corrected_success(held.take(mine), fitted))
        if crossed.sum() < plain.sum():
            losses, corrected = crossed, True
    total = np.bincount(held.fold, losses)
    count = np.bincount(held.fold, held.attempts).astype(np.float64)
    mean = float(losses.sum() / held.attempts.sum())
    half = _half_width(total / count, count)
    return Score(name, tuple((total / count).tolist()), corrected, mean, mean - half, mean + half)


def _beside(score: Score, base: Score, held: _Held) -> Score:
    """The score with its gain over the baseline; the trials that are judged are the same."""
    count = np.bincount(held.fold, held.attempts).astype(np.float64)
    gains = np.array(base.losses) - np.array(score.losses)
    mean = float(gains @ count / count.sum())
    half = _half_width(gains, count)
    return Score(
        score.model, score.losses, score.corrected, score.loss, score.low, score.high, mean, mean - half, mean + half
    )


def _winner(ranked: Sequence[Score], held: _Held) -> Score:
    """The first, or the first that is no ensemble, if that is no more than a standard error behind."""
    first, other = ranked[0], next(score for score in ranked if score.model not in ENSEMBLES)
    count = np.bincount(held.fold, held.attempts).astype(np.float64)
    behind = np.array(other.losses) - np.array(first.losses)
    is_near = float(behind @ count / count.sum()) <= _standard_error(behind, count)
    return other if is_near else first


def _half_width(values: Array, weights: Array) -> float:
    """Of a 90 % interval of a weighted mean over folds."""
    return float(stats.t.ppf(0.95, len(values) - 1)) * _standard_error(values, weights)


def _standard_error(values: Array, weights: Array) -> float:
    """Of a weighted mean over folds."""
    share, k = weights / weights.sum(), len(values)
    variance = float(share**2 @ (values - float(values @ share)) ** 2) * k / (k - 1)
    return float(np.sqrt(variance))


def _enough(held: _Held) -> bool:
    total, wins = int(held.attempts.sum()), int(held.successes.sum())
    return total >= _ENOUGH and min(wins, total - wins) >= _ENOUGH // 4


def _fit_correction(held: _Held, model: str, corrected: bool) -> Correction:
    """By maximum likelihood with a ridge; for an ensemble, with the variance of what single pairs add."""
    is_ensemble = model in ENSEMBLES
    if model == BASELINE or not (corrected or is_ensemble):
        return Correction()
    free = np.array([corrected, corrected, is_ensemble])

    def correction(parameters: Array) -> Correction:
        slope, shift, own = np.where(free, parameters, 0.0)
        variance = _OWN_VARIANCE * float(np.exp(own)) if is_ensemble else 0.0
        return Correction(Platt(float(np.exp(slope)), float(shift)), variance)

    def loss(parameters: Array) -> float:
        fitted = correction(parameters)
        mean, variance = _moments(held, fitted)
        z = mean + np.sqrt(variance) * _NODES[:, None]
        log_p = held.successes * z - held.attempts * np.logaddexp(0.0, z)
        value = -float(special.logsumexp(log_p, axis=0, b=(_WEIGHTS / _WEIGHTS.sum())[:, None]).sum())
        return value + _RIDGE * float(parameters @ (np.array([1.0, 1.0, 1.0]) * parameters))

    limits = [(-1.5, 1.0), (-3.0, 3.0), (-3.0, 2.0)]
    return correction(optimize.minimize(loss, np.zeros(3), method="L-BFGS-B", bounds=limits).x)


def _moments(held: _Held, fitted: Correction) -> tuple[Array, Array]:
    slope = fitted.platt.slope
    return slope * held.logit + fitted.platt.shift, slope**2 * held.variance + fitted.own_variance


def _corrected_success(held: _Held, fitted: Correction) -> Array:
    return np.asarray(expected_success(*_moments(held, fitted)))


def _reason(best: Score, base: Score) -> str:
    if best.model == BASELINE:
        return "no model predicts held-out tasks clearly better than success rates by kind of pair"
    losses = f"log loss on held-out tasks {best.loss:.3f}, base rates {base.loss:.3f}"
    return losses if best.gain_low > 0.0 else f"{losses}, a gain that may be chance"
