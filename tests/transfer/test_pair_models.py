"""Every model of transfer: what trials do to it, and whether its intervals hold the truth."""

import numpy as np
import pytest

from p2l.transfer.few_trials import SAME_FAMILY, SAME_TASK, Prior, Trials, all_pairs
from p2l.transfer.pair_models import MODELS, FitSetting, ensemble, own_counts, rates
from p2l.transfer.prediction import predict
from tests.transfer import shop


@pytest.fixture(scope="module")
def example():
    rng = np.random.default_rng(3)
    tasks = shop.table(rng)
    p = shop.truth(tasks, rng)
    return tasks, p, shop.tried(p, rng)


@pytest.mark.parametrize("name", MODELS)
def test_a_model_tells_families_apart_and_is_never_certain(example, name):
    tasks, p, trials = example
    query = all_pairs(tasks)
    belief = MODELS[name](shop.setting(tasks), trials, query, np.random.default_rng(0))
    low, high = belief.interval(0.9)
    assert ((low > 0.0) & (low < belief.mean) & (belief.mean < high) & (high < 1.0)).all()
    family = query.group == SAME_FAMILY
    assert belief.mean[family].mean() > belief.mean[query.group > SAME_FAMILY].mean() + 0.1
    assert np.abs(belief.mean - p.ravel()).mean() < 0.2


@pytest.mark.parametrize("name", MODELS)
def test_the_same_generator_gives_the_same_belief(example, name):
    tasks, _, trials = example
    query = all_pairs(tasks)
    twice = [MODELS[name](shop.setting(tasks, 5), trials, query, np.random.default_rng(1)).mean for _ in range(2)]
    assert np.array_equal(*twice)


@pytest.mark.parametrize("name", MODELS)
def test_turning_a_pair_s_failures_into_successes_raises_it(example, name):
    tasks, _, trials = example
    query = all_pairs(tasks)
    pair = int(trials.taught[0]) * len(tasks.names) + int(trials.tested[0])
    means = []
    for wins in (0, 6):
        changed = Trials(
            trials.taught,
            trials.tested,
            np.concatenate([[wins], trials.successes[1:]]),
            np.concatenate([[6], trials.attempts[1:]]),
        )
        means.append(MODELS[name](shop.setting(tasks), changed, query, np.random.default_rng(2)).mean[pair])
    assert means[1] > means[0] + 0.05


def test_without_trials_the_stated_prior_is_all():
    tasks = shop.table(np.random.default_rng(0))
    query = all_pairs(tasks)
    setting = FitSetting(tasks, Prior(0.95, 0.7, 0.2, 4.0))
    belief = rates(setting, Trials.none(), query, np.random.default_rng(0))
    np.testing.assert_allclose(belief.mean, np.array([0.95, 0.7, 0.2])[query.group])
    np.testing.assert_allclose(belief.successes + belief.failures, 4.0)


def test_rates_of_one_trial_by_hand():
    """One success in the family: others of the kind at (2 · 0.6 + 1) / 3, the pair itself adds its own to the prior."""
    tasks = shop.table(np.random.default_rng(0))
    trials = Trials(*(np.array([each]) for each in (0, 5, 1, 1)))  # families repeat every 5 tasks
    query = all_pairs(tasks)
    belief = rates(FitSetting(tasks, Prior()), trials, query, np.random.default_rng(0))
    family = query.group == SAME_FAMILY
    itself = (query.taught == 0) & (query.tested == 5)
    np.testing.assert_allclose(belief.mean[family & ~itself], 2.2 / 3.0)
    np.testing.assert_allclose(belief.mean[query.group == SAME_TASK], 0.9)
    assert belief.mean[itself][0] == pytest.approx((2.0 * 0.6 + 1.0) / 3.0)


def test_own_counts_find_each_pair():
    tasks = shop.table(np.random.default_rng(0))
    trials = Trials(*(np.array(each) for each in ([3, 19], [4, 0], [1, 2], [2, 5])))
    successes, attempts = (each.reshape(20, 20) for each in own_counts(all_pairs(tasks), trials))
    assert (successes[3, 4], attempts[3, 4], successes[19, 0], attempts[19, 0]) == (1, 2, 2, 5)
    assert attempts.sum() == 7


def test_an_ensemble_sees_no_correlation_that_is_chance():
    rng = np.random.default_rng(0)
    shared = rng.normal(size=(60, 1))
    belief = ensemble(np.hstack([shared, shared + 0.1 * rng.normal(size=(60, 1)), rng.normal(size=(60, 200))]))
    row = belief.covariance(0) / np.sqrt(belief.variance * belief.variance[0])
    assert row[0] == pytest.approx(1.0)
    assert row[1] > 0.9
    assert (row[2:] == 0.0).mean() > 0.9


@pytest.mark.slow
def test_intervals_of_the_chosen_model_hold_the_truth_about_as_often_as_they_say():
    """90 % intervals over six made-up shops; honest is 80 to 98 %."""
    held = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        tasks = shop.table(rng)
        p = shop.truth(tasks, rng)
        trials = shop.tried(p, rng)
        prediction = predict(shop.setting(tasks, 10), trials, ("logistic", "gp", "net"), 4, 15, 0.9, rng=rng)
        held.append(((prediction.low <= p) & (p <= prediction.high)).mean())
    assert 0.80 <= np.mean(held) <= 0.98
    assert min(held) > 0.6


def test_support_names_a_pair_s_own_trials_first(example):
    tasks, _, trials = example
    prediction = predict(shop.setting(tasks, 10), trials, ("logistic",), 4, 15, 0.9, rng=np.random.default_rng(0))
    own = trials.taught * len(tasks.names) + trials.tested
    assert prediction.support[own, 0].tolist() == list(range(len(trials)))
    assert prediction.trials.sum() == trials.attempts.sum()
