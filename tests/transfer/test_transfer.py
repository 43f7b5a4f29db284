"""The predictor: splits that never leak, recovery of a known transfer, determinism, round trips, refusals."""

from dataclasses import replace

import hypothesis.strategies as st
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from numpy.testing import assert_array_equal
from scipy.special import expit

from p2l.errors import ArtifactError, ConfigError, ShapeError
from p2l.evaluation.transfer.fit import held_out_predictions
from p2l.evaluation.transfer.scores import calibration_table, records, score_table, task_weights
from p2l.records import TransferData
from p2l.transfer import baselines
from p2l.transfer.calibration import auc
from p2l.transfer.fitting import FitOptions, TaskSplit, fit, fit_best, split_tasks
from p2l.transfer.model import load_transfer_model

DRAWS = 20
QUICK = FitOptions(hidden=32, epochs=60, members=3, patience=20, batch_size=256)


def make_data(seed=0, m=40, k=20, relative=True):
    """Transfer that depends on a distance (relative) or on which side both tasks are (not), and its true table."""
    rng = np.random.default_rng(seed)
    features = rng.uniform(-1, 1, (m, 2)) * np.array([1.0, 100.0])
    x = features / np.array([1.0, 100.0])
    taught = rng.permutation(m)[:k]
    if relative:
        truth = expit(4 - 6 * np.linalg.norm(x[taught][:, None] - x[None], axis=2))
    else:
        truth = np.where((x[taught, 0] > 0)[:, None] >= (x[:, 0] > 0)[None], 0.9, 0.1)
    data = TransferData(
        names=tuple(f"t{i}" for i in range(m)),
        features=features,
        feature_names=("x", "y_percent"),
        group=(x[:, 1] > 0).astype(np.int64),
        train_task=taught,
        successes=rng.binomial(DRAWS, truth),
        draws=DRAWS,
        skills=np.zeros((k, 1)),
    )
    return data, truth


def fitted(data, encoding, seed=0, options=QUICK):
    split = split_tasks(data, 0.2, options.members, np.random.default_rng(seed))
    return split, fit(data, encoding, split, options, torch.Generator().manual_seed(seed))


@pytest.fixture(scope="module")
def relative():
    data, truth = make_data()
    return data, truth, *fitted(data, "difference")


@given(st.integers(6, 60), st.floats(0.05, 0.4), st.integers(2, 4), st.integers(0, 2**32 - 1))
def test_split_deals_every_task_once_and_evenly(m, holdout, members, seed):
    data, _ = make_data(seed=1, m=m, k=max(3, m // 2))
    split = split_tasks(data, holdout, members, np.random.default_rng(seed))
    assert split.held_out.sum() == max(1, round(holdout * m))
    sizes = np.bincount(split.fold[~split.held_out], minlength=members)
    assert sizes.sum() + split.held_out.sum() == m
    assert sizes.max() - sizes.min() <= 1
    # a share of the taught tasks is held out, not all and not many more than their part
    taught = split.held_out[data.train_task]
    assert abs(taught.sum() - split.held_out.sum() * taught.size / m) <= 1


def test_held_out_tasks_cannot_influence_the_fit():
    data, _ = make_data()
    options = replace(QUICK, epochs=6)
    split, found = fitted(data, "difference", options=options)
    hidden = split.held_out
    features, successes = data.features.copy(), data.successes.copy()
    features[hidden] = 1e3
    successes[:, hidden] = DRAWS - successes[:, hidden]
    successes[hidden[data.train_task]] = DRAWS - successes[hidden[data.train_task]]
    changed = replace(data, features=features, successes=successes)
    again = fit(changed, "difference", split, options, torch.Generator().manual_seed(0))
    for name, value in found.model.weights.items():
        assert torch.equal(value, again.model.weights[name])
    assert again.model.platt == found.model.platt
    assert_array_equal(
        baselines.constant(data, split, features[:2], features[:3]),
        baselines.constant(changed, split, features[:2], features[:3]),
    )


def test_recovers_a_known_relative_transfer(relative):
    data, truth, split, found = relative
    new = np.flatnonzero(split.held_out)
    predicted = found.model.predict(data.features[data.train_task], data.features[new])
    assert np.abs(predicted - truth[:, new]).mean() < 0.08
    assert predicted.shape == (20, len(new))
    assert predicted.dtype == np.float64


def test_recovers_a_known_asymmetric_transfer():
    data, truth = make_data(m=60, k=30, relative=False)
    split, found = fitted(data, "concatenation")
    new = np.flatnonzero(split.held_out)
    predicted = found.model.predict(data.features[data.train_task], data.features[new])
    assert np.mean((predicted > 0.5) == (truth[:, new] > 0.5)) > 0.9


@settings(max_examples=20)
@given(st.floats(-50, 50), st.floats(-50, 50))
def test_the_difference_encoding_does_not_see_a_common_shift(relative, dx, dy):
    data, _, _, found = relative
    a, b = data.features[:4], data.features[4:9]
    shift = np.array([dx, dy])
    np.testing.assert_allclose(found.model.predict(a + shift, b + shift), found.model.predict(a, b), atol=1e-4)


def test_equal_seeds_give_equal_models_and_others_do_not():
    data, _ = make_data(m=20, k=8)
    options = replace(QUICK, epochs=5)
    models = [fitted(data, "difference", seed, options)[1].model for seed in (3, 3, 4)]
    tables = [model.predict(data.features, data.features) for model in models]
    assert_array_equal(tables[0], tables[1])
    assert not np.array_equal(tables[0], tables[2])


def test_each_member_keeps_its_best_epoch(relative):
    *_, found = relative
    assert_array_equal(found.validation_loss.argmin(axis=0), found.best_epoch)
    assert found.training_loss.shape == found.validation_loss.shape


def test_correction_does_not_change_the_ranking_of_held_out_pairs(relative):
    data, _, split, found = relative
    scores = {
        one.method: float(auc(one.p, one.successes, DRAWS))
        for one in held_out_predictions(data, found.model, split)[:4]
    }
    assert scores["model"] == scores["uncorrected"]
    assert scores["model"] > 0.9
    assert scores["constant"] == 0.5


def test_predictions_do_not_depend_on_what_else_is_asked(relative):
    data, _, _, found = relative
    whole = found.model.predict(data.features, data.features)
    part = found.model.predict(data.features[5:7], data.features[3:4])
    np.testing.assert_allclose(part, whole[5:7, 3:4], rtol=1e-5)


def test_round_trip_gives_identical_predictions_and_refuses_others(relative, tmp_path):
    data, _, _, found = relative
    path = tmp_path / "transfer_model.safetensors"
    found.model.save(path, domain="plane", config_hash="abc")
    loaded = load_transfer_model(path, feature_names=("x", "y_percent"), encoding="difference")
    assert_array_equal(loaded.predict(data.features, data.features), found.model.predict(data.features, data.features))
    with pytest.raises(ArtifactError, match=r"plane.*feature_names"):
        load_transfer_model(path, feature_names=("x", "z"), encoding="difference")
    with pytest.raises(ArtifactError, match="encoding"):
        load_transfer_model(path, feature_names=("x", "y_percent"), encoding="concatenation")
    path.write_bytes(path.read_bytes()[:-1] + b"\x01")
    with pytest.raises(ArtifactError, match="weights"):
        load_transfer_model(path, feature_names=("x", "y_percent"), encoding="difference")


def test_features_of_the_wrong_shape_are_refused(relative):
    model = relative[3].model
    with pytest.raises(ShapeError, match="takes 2"):
        model.predict(np.zeros((2, 3)), np.zeros((2, 2)))
    with pytest.raises(ShapeError, match="NaN"):
        model.predict(np.full((1, 2), np.nan), np.zeros((2, 2)))


def test_too_little_data_is_refused_and_the_least_is_enough():
    data, _ = make_data(m=6, k=3)
    _, found = fitted(data, "difference", options=replace(QUICK, epochs=2))
    assert np.isfinite(found.model.predict(data.features, data.features)).all()
    few, _ = make_data(m=6, k=2)
    with pytest.raises(ConfigError, match="taught"):
        split_tasks(few, 0.2, 3, np.random.default_rng(0))


def test_nearest_neighbour_by_hand():
    data, _ = make_data(m=8, k=4)
    split = TaskSplit(np.array([-1, 0, 1, 0, 1, 0, 1, 0]))
    _, found = fitted(data, "concatenation", options=replace(QUICK, epochs=1, members=2))
    row = int(np.flatnonzero(~split.held_out[data.train_task])[0])
    train, test = data.features[data.train_task[[row]]], data.features[[3]]
    one = baselines.nearest_neighbour(data, split, found.model, train, test, neighbours=1)
    assert one.item() == pytest.approx((data.successes[row, 3] + 0.5) / (DRAWS + 1))


def test_tables_of_scores_and_calibration(relative):
    data, _, split, found = relative
    predictions = held_out_predictions(data, found.model, split)
    table = score_table(predictions, np.random.default_rng(0))
    assert len(table) == 2 * 4 * 4
    assert np.all((table["low"] <= table["mean"] + 0.05) & (table["mean"] <= table["high"] + 0.05))
    score = table.set_index(["method", "pairs", "metric"])["mean"]
    assert score["model", "new_test", "brier"] < score["constant", "new_test", "brier"]
    assert len(records(table)) == len(table)
    curve = calibration_table(predictions)
    pairs = split.held_out.sum() * len(data.train_task)
    assert np.all(curve.groupby("method")["pairs"].sum() == pairs)
    filled = curve[curve["pairs"] > 0]
    assert np.all((filled["low"] <= filled["rate"]) & (filled["rate"] <= filled["high"]))


def test_bootstrap_weights_draw_tasks_not_pairs(relative):
    data, _, split, found = relative
    predictions = held_out_predictions(data, found.model, split)
    new_test = next(one for one in predictions if one.pairs == "new_test")
    weights = task_weights(new_test, 50, np.random.default_rng(0))
    for task in np.unique(new_test.test_task):
        columns = weights[:, new_test.test_task == task]
        assert np.all(columns == columns[:, :1])
    both = next(one for one in predictions if one.pairs == "both_new")
    assert np.all(task_weights(both, 50, np.random.default_rng(0)).sum(axis=1) <= len(both.p) * 8)


def test_the_weight_decay_is_that_of_the_smallest_loss_on_folds_and_never_sees_held_out_tasks():
    data, _ = make_data()
    split = split_tasks(data, 0.2, QUICK.members, np.random.default_rng(0))
    options, decays = replace(QUICK, epochs=8), (0.0, 3.0, 30.0)
    best, losses = fit_best(data, "difference", split, options, decays, 0)
    assert list(losses) == list(decays)
    assert best.loss == min(losses.values())
    assert losses[0.0] < losses[30.0]
    hidden = split.held_out
    successes = data.successes.copy()
    successes[:, hidden] = DRAWS - successes[:, hidden]
    successes[hidden[data.train_task]] = DRAWS - successes[hidden[data.train_task]]
    assert fit_best(replace(data, successes=successes), "difference", split, options, decays, 0)[1] == losses
    with pytest.raises(ConfigError, match="none given"):
        fit_best(data, "difference", split, options, (), 0)
