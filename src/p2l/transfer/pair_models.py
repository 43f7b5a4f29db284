"""Models of transfer that a few trials can be fitted with; the thesis's network is one of them (section 3.3.2).

Every model is a function of the tasks, the trials, the pairs that are asked about and what is believed beforehand.
`rates` is the baseline: success by kind of pair. `logistic` and `gp` are Gaussian processes with the stated priors as
their mean. `trees` and `net` are ensembles of `members`, each fitted with random weights of the tasks (the Bayesian
bootstrap): a pair counts as the product of its two tasks' weights, since pairs that share a task are not independent.

Deviations from the thesis: 1. Its network is fitted to counts of single pairs rather than to a full table. 2. Other
models may replace it: some dozens of trials are few for a network.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy import special
from threadpoolctl import threadpool_limits

from p2l.records import Array
from p2l.transfer.beliefs import Belief, BetaBelief, LatentBelief
from p2l.transfer.few_trials import OTHER, Prior, TaskPairs, TaskTable, Trials, pairs_of
from p2l.transfer.kernels import linear_kernel, smooth_kernel
from p2l.transfer.processes import Kernel, belief_of, fit_process

_TREES = 10  # of each member
_CLIP = 0.02  # no forest is surer than this
_HIDDEN, _EPOCHS, _RATE, _DECAY = 16, 100, 0.02, 1.0
_GRID = 2.0 ** np.arange(-2.0, 5.0)  # multiples of the stated pseudo-count


@dataclass(frozen=True)
class FitSetting:
    """What a model works with besides the trials.

    Attributes:
        tasks: all of them.
        prior: what is believed without trials.
        members: of an ensemble.
    """

    tasks: TaskTable
    prior: Prior
    members: int = 60

    @property
    def group_rates(self) -> Array:
        """[3] stated success by group of pairs."""
        return self.prior.of_groups(self.tasks.family is not None)


Model = Callable[[FitSetting, Trials, TaskPairs, np.random.Generator], Belief]


def rates(setting: FitSetting, trials: Trials, query: TaskPairs, rng: np.random.Generator) -> BetaBelief:  # noqa: ARG001
    """Success by kind of pair: the stated prior, its kind's other trials, then the pair's own trials.

    How far pairs of one kind differ is the pseudo-count, which trials may change by their beta-binomial likelihood.
    """
    tried = pairs_of(setting.tasks, trials.taught, trials.tested)
    count = setting.prior.pseudo_count
    sums = [np.bincount(tried.group, each, OTHER + 1) for each in (trials.successes, trials.attempts)]

    def means(pairs: TaskPairs, successes: Array, attempts: Array) -> Array:
        stated = count * setting.group_rates[pairs.group]
        return (stated + sums[0][pairs.group] - successes) / (count + sums[1][pairs.group] - attempts)

    s, n = trials.successes.astype(np.float64), trials.attempts.astype(np.float64)
    m = means(tried, s, n)
    concentration = count * _GRID[:, None]
    likelihood = special.betaln(concentration * m + s, concentration * (1 - m) + n - s)
    likelihood -= special.betaln(concentration * m, concentration * (1 - m))
    scores = likelihood.sum(axis=1) - 0.5 * (np.log(_GRID) / np.log(2.0)) ** 2
    chosen = count * float(_GRID[int(scores.argmax())]) if len(trials) else count
    own = own_counts(query, trials)
    mean = means(query, own[0], own[1])
    return BetaBelief(chosen * mean + own[0], chosen * (1.0 - mean) + own[1] - own[0])


def logistic(setting: FitSetting, trials: Trials, query: TaskPairs, rng: np.random.Generator) -> LatentBelief:  # noqa: ARG001
    """Bayesian logistic regression with an effect of each pair's own."""
    return _process(linear_kernel(query.signed.shape[1], query.same.shape[1]), setting, trials, query)


def gp(setting: FitSetting, trials: Trials, query: TaskPairs, rng: np.random.Generator) -> LatentBelief:  # noqa: ARG001
    """Gaussian process classification of the differences."""
    return _process(smooth_kernel(query.signed.shape[1], query.same.shape[1]), setting, trials, query)


def _process(kernel: Kernel, setting: FitSetting, trials: Trials, query: TaskPairs) -> LatentBelief:
    stated = special.logit(setting.group_rates)
    tried = pairs_of(setting.tasks, trials.taught, trials.tested)
    with threadpool_limits(1, "blas"):  # hundreds of small matrices: threads would wait for each other
        theta, posterior = fit_process(kernel, tried, stated[tried.group], trials.successes, trials.attempts)
    return belief_of(kernel, theta, posterior, tried, query, stated[query.group])


def trees(setting: FitSetting, trials: Trials, query: TaskPairs, rng: np.random.Generator) -> LatentBelief:
    """Extremely randomised trees on both tasks' features, their differences and what is the same."""
    from sklearn.ensemble import ExtraTreesRegressor

    tried = pairs_of(setting.tasks, trials.taught, trials.tested)
    x, asked = (np.hstack([pairs.both, pairs.differences]) for pairs in (tried, query))
    share = trials.successes / trials.attempts
    logits = np.empty((setting.members, len(query)))
    for member, weight in enumerate(_bootstrap(setting, trials, rng)):
        seed = int(rng.integers(2**31))
        forest = ExtraTreesRegressor(_TREES, min_samples_leaf=2, max_features=0.5, random_state=seed)
        forest.fit(x, share, sample_weight=weight)
        logits[member] = special.logit(np.clip(forest.predict(asked), _CLIP, 1.0 - _CLIP))
    return ensemble(logits)


def net(setting: FitSetting, trials: Trials, query: TaskPairs, rng: np.random.Generator) -> LatentBelief:
    """The thesis's network of two layers on the difference of two tasks, its members side by side, by Adam."""
    tried = pairs_of(setting.tasks, trials.taught, trials.tested)
    x, asked = (np.hstack([pairs.signed, pairs.same]) for pairs in (tried, query))
    e, d = setting.members, x.shape[1]
    share = trials.successes / trials.attempts
    weight = _bootstrap(setting, trials, rng)
    weight /= weight.sum(axis=1, keepdims=True)
    layers = [
        rng.standard_normal((e, d, _HIDDEN)) * (2.0 / d) ** 0.5,
        np.zeros((e, 1, _HIDDEN)),
        rng.standard_normal((e, _HIDDEN)) * _HIDDEN**-0.5,
        np.zeros((e, 1)),
    ]
    moments = [(np.zeros_like(each), np.zeros_like(each)) for each in layers]
    for epoch in range(1, _EPOCHS + 1):
        hidden = np.maximum(x @ layers[0] + layers[1], 0.0)  # [E, N, H]
        error = weight * (special.expit(np.einsum("enh,eh->en", hidden, layers[2]) + layers[3]) - share)
        back = error[:, :, None] * layers[2][:, None] * (hidden > 0.0)
        slopes = [x.T @ back, back.sum(axis=1, keepdims=True), np.einsum("enh,en->eh", hidden, error)]
        slopes.append(error.sum(axis=1, keepdims=True))
        for at, slope in enumerate(slopes):
            first, second = moments[at]
            first += 0.1 * (slope - first)
            second += 0.001 * (slope**2 - second)
            step = first / (1.0 - 0.9**epoch) / (np.sqrt(second / (1.0 - 0.999**epoch)) + 1e-8)
            layers[at] -= _RATE * (step + (_DECAY * layers[at] if at in (0, 2) else 0.0))  # biases do not decay
    hidden = np.maximum(asked @ layers[0] + layers[1], 0.0)
    return ensemble(np.einsum("eqh,eh->eq", hidden, layers[2]) + layers[3])


MODELS: Mapping[str, Model] = {"rates": rates, "logistic": logistic, "gp": gp, "trees": trees, "net": net}
ENSEMBLES = ("trees", "net")


def ensemble(logits: Array) -> LatentBelief:
    """What members' logits [E, Q] say together.

    Correlations that E members show by chance are taken off (soft threshold of two standard errors): a plan chooses
    among thousands of pairs, and would find value in noise.
    """
    mean, members = logits.mean(axis=0), len(logits)
    centred = (logits - mean) / np.sqrt(members - 1)
    variance = np.maximum((centred**2).sum(axis=0), 1e-6)
    chance = min(0.9, 2.0 / np.sqrt(members))

    def covariance(pair: int) -> Array:
        deviation = np.sqrt(variance * variance[pair])
        correlation = centred[:, pair] @ centred / deviation
        kept = np.sign(correlation) * np.maximum(np.abs(correlation) - chance, 0.0) / (1.0 - chance)
        kept[pair] = 1.0
        return kept * deviation

    return LatentBelief(mean, variance, covariance)


def own_counts(query: TaskPairs, trials: Trials) -> tuple[Array, Array]:
    """[Q] successes and [Q] attempts of each pair itself."""
    m = 1 + max(int(each.max(initial=0)) for each in (query.taught, query.tested, trials.taught, trials.tested))
    tables = np.zeros((2, m * m))
    tables[:, trials.taught * m + trials.tested] = trials.successes, trials.attempts
    own = tables[:, query.taught * m + query.tested]
    return own[0], own[1]


def _bootstrap(setting: FitSetting, trials: Trials, rng: np.random.Generator) -> Array:
    """[E, N] weights of the trials: exponential ones of tasks, multiplied, times attempts."""
    task = rng.exponential(size=(setting.members, len(setting.tasks.names)))
    return np.asarray(task[:, trials.taught] * task[:, trials.tested] * trials.attempts)
