"""The choice of a model: nothing of a held-out task is fitted, and few trials choose nothing."""

import numpy as np
import pytest

from p2l.transfer import validation
from p2l.transfer.few_trials import Trials
from p2l.transfer.pair_models import MODELS, rates
from p2l.transfer.validation import Correction, choose, deal_folds
from tests.transfer import shop

RNG = np.random.default_rng


@pytest.fixture(scope="module")
def example():
    rng = RNG(3)
    tasks = shop.table(rng)
    p = shop.truth(tasks, rng)
    return tasks, shop.tried(p, rng)


def test_folds_hold_families_evenly():
    tasks = shop.table(RNG(0))
    fold = deal_folds(shop.setting(tasks), 4, RNG(1))
    assert np.bincount(fold).tolist() == [5, 5, 5, 5]
    for family in range(5):
        assert sorted(fold[tasks.family == family]) == [0, 1, 2, 3]


def test_a_held_out_task_is_in_no_fitted_trial_and_in_every_judged_one(example, monkeypatch):
    tasks, trials = example
    seen = []

    def watched(setting, fitted, query, rng):
        seen.append((set(fitted.taught) | set(fitted.tested), query))
        return rates(setting, fitted, query, rng)

    monkeypatch.setitem(MODELS, "watched", watched)
    choose(shop.setting(tasks), trials, ["watched"], 4, 15, RNG(0))
    fold = deal_folds(shop.setting(tasks), 4, RNG(0))
    assert len(seen) == 4
    for number, (fitted, query) in enumerate(seen):
        held = set(np.flatnonzero(fold == number))
        assert not fitted & held
        assert all({i, j} & held for i, j in zip(query.taught, query.tested, strict=True))
        meets = np.isin(trials.taught, list(held)) | np.isin(trials.tested, list(held))
        assert len(query) == meets.sum()


def test_scores_are_log_losses_per_trial(example):
    """The baseline's, computed anew by a loop over trials."""
    tasks, trials = example
    setting = shop.setting(tasks)
    [score] = [each for each in choose(setting, trials, [], 4, 15, RNG(0)).scores if each.model == "rates"]
    fold = deal_folds(setting, 4, RNG(0))
    total = count = 0.0
    for number in range(4):
        out = (fold[trials.taught] == number) | (fold[trials.tested] == number)
        for row in np.flatnonzero(out):
            one = trials.take(np.array([row]))
            query = validation.pairs_of(tasks, one.taught, one.tested)
            p = rates(setting, trials.take(np.flatnonzero(~out)), query, RNG(0)).mean[0]
            s, n = int(one.successes[0]), int(one.attempts[0])
            total -= s * np.log(p) + (n - s) * np.log1p(-p)
            count += n
    assert score.loss == pytest.approx(total / count, abs=1e-12)
    assert score.low < score.loss < score.high
    assert (score.gain, score.gain_low, score.gain_high) == (0.0, 0.0, 0.0)


def test_the_choice_beats_the_baseline_where_features_tell_all():
    rng = RNG(5)
    tasks = shop.table(rng, 24)
    trials = shop.tried(shop.truth(tasks, rng, own=0.0), rng, 200)
    choice = choose(shop.setting(tasks, 10), trials, list(MODELS), 4, 15, rng)
    best = choice.scores[0]
    assert choice.model in ("logistic", "gp")
    assert best.gain_low > 0.0
    assert [each.loss for each in choice.scores] == sorted(each.loss for each in choice.scores)


@pytest.mark.parametrize(
    ("trials", "reason"),
    [
        (Trials.none(), "no trials"),
        (Trials(*(np.array(each) for each in ([0, 1], [1, 2], [1, 0], [1, 1]))), "fewer than 15"),
        (Trials(np.arange(20), np.arange(20), np.full(20, 2), np.full(20, 2)), "fewer than 3 trials of one outcome"),
        (
            Trials(np.repeat(np.arange(5), 5), np.tile(np.arange(5), 5), np.tile([0, 1, 1, 0, 1], 5), np.full(25, 1)),
            "fold",
        ),
    ],
)
def test_too_few_trials_choose_nothing_and_say_so(trials, reason):
    tasks = shop.table(RNG(0))
    choice = choose(shop.setting(tasks), trials, list(MODELS), 20 if reason == "fold" else 4, 15, RNG(0))
    assert (choice.model, choice.scores, choice.correction) == ("rates", (), Correction())
    assert reason in choice.reason


@pytest.mark.parametrize("kind", ["family", "words", "a number", "two tasks", "more folds than tasks"])
def test_little_that_is_known_of_tasks_is_enough_or_is_told(kind):
    rng, m = RNG(1), 2 if kind == "two tasks" else 12
    numeric = rng.normal(size=(m, 1 if kind == "a number" else 0))
    words = rng.integers(0, 3, (m, 1 if kind == "words" else 0))
    family = np.arange(m) % 3 if kind == "family" or m == 2 else None
    tasks = shop.TaskTable(
        tuple("abcdefghijkl"[:m]), ("x",) * numeric.shape[1], numeric, ("y",) * words.shape[1], words, family
    )
    taught, tested = np.divmod(rng.choice(m * m, min(60, m * m), replace=False), m)
    trials = Trials(taught, tested, rng.integers(0, 3, len(taught)), np.full(len(taught), 2))
    folds = 20 if kind == "more folds than tasks" else 4
    choice = choose(shop.setting(tasks, 5), trials, list(MODELS), folds, 4, rng)
    assert (len(choice.scores) == 0) == (kind in ("two tasks", "more folds than tasks"))
    assert choice.model in MODELS


def test_an_ensemble_has_to_be_better_by_more_than_a_standard_error():
    n = np.full(4, 10)
    held = validation._Held(np.zeros(4), np.zeros(4), n, n, np.arange(4))

    def score(model, *losses):
        return validation.Score(model, losses, False, float(np.mean(losses)), 0.0, 1.0)

    gp = score("gp", 0.40, 0.42, 0.44, 0.46)
    near, clear = score("trees", 0.44, 0.36, 0.48, 0.40), score("trees", 0.30, 0.31, 0.35, 0.34)
    assert validation._winner([near, gp], held) is gp
    assert validation._winner([clear, gp], held) is clear
    assert validation._winner([gp, near], held) is gp


def test_a_correction_undoes_logits_that_are_twice_too_large():
    rng = RNG(0)
    true = rng.normal(0.0, 1.5, 2000)
    n = np.full(2000, 4)
    held = validation._Held(2.0 * true + 1.0, np.zeros(2000), rng.binomial(n, 1 / (1 + np.exp(-true))), n, n * 0)
    fitted = validation._fit_correction(held, "gp", corrected=True)
    assert fitted.platt.slope == pytest.approx(0.5, abs=0.03)
    assert fitted.platt.shift == pytest.approx(-0.5, abs=0.08)
    assert fitted.own_variance == 0.0
