"""Pairs of tasks as walls: hand-computed cases, mirrored tasks, and a predictor that learns from them."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from p2l.domains.insertion.features import DISTANCE_NAMES, FEATURE_NAMES
from p2l.domains.insertion.layouts import make_tasks
from p2l.errors import ArtifactError, ShapeError
from p2l.records import TransferData
from p2l.transfer import baselines
from p2l.transfer.calibration import auc
from p2l.transfer.encodings import PLAY_CM, SIDES, name_in_records, wall_pairs, width
from p2l.transfer.fitting import FitOptions, fit, split_tasks
from p2l.transfer.model import load_transfer_model

DISTANCES = st.lists(st.sampled_from([1.1, 1.4, 2.0, 2.9, 4.0]), min_size=4, max_size=4)
# left, right, bottom, top after a mirror in x, one in y, and a quarter turn against the clock
MOVES = ([1, 0, 2, 3], [0, 1, 3, 2], [3, 2, 0, 1])


def pair(lesson, tested):
    """Smallest and largest shift (cm), walls that tie, distance of the lesson's wall (cm)."""
    least, largest, ties, wall = wall_pairs(SIDES, np.array([lesson], dtype=float), np.array([tested], dtype=float))[
        0, 0
    ]
    return np.array([np.sinh(least) * PLAY_CM, np.sinh(largest) * PLAY_CM, ties, wall])


def test_the_sides_are_those_of_the_insertion_domain():
    assert SIDES == DISTANCE_NAMES


def test_by_hand_the_shift_of_the_wall_that_the_lesson_leans_on():
    assert_allclose(pair([2.9, 1.1, 4.0, 2.0], [1.1, 2.0, 4.0, 4.0]), [0.9, 0.9, 1.0, 1.1])
    # Its own wall is as far, whatever the others are.
    assert_allclose(pair([2.9, 1.1, 4.0, 2.0], [1.1, 1.1, 1.1, 1.1]), [0.0, 0.0, 1.0, 1.1])
    # The tested slot has no wall on that side: its distance is the largest that a feature has.
    assert_allclose(pair([2.9, 2.0, 4.0, 2.9], [1.1, 4.0, 1.1, 1.1]), [2.0, 2.0, 1.0, 2.0])


def test_by_hand_equally_near_walls_may_each_be_leant_on():
    assert_allclose(pair([2.0, 4.0, 2.0, 2.9], [1.1, 1.1, 2.0, 1.1]), [0.0, -0.9, 2.0, 2.0])
    assert_allclose(pair([2.0, 4.0, 2.005, 2.9], [4.0, 1.1, 1.1, 1.1]), [-0.905, 2.0, 2.0, 2.0])
    assert_allclose(pair([2.0, 4.0, 2.02, 2.9], [4.0, 1.1, 1.1, 1.1]), [2.0, 2.0, 1.0, 2.0])


def test_by_hand_from_scenes():
    """A wall 2 cm to the left, seen from a slot whose wall there is 1.1 cm away."""
    near, far = np.array([[-0.016, 0.0, 0.005, 0.03]]), np.array([[-0.025, 0.0, 0.005, 0.03]])
    tasks = make_tasks(["near", "far"], [0, 0], [near, far])
    pairs = wall_pairs(FEATURE_NAMES, tasks.features, tasks.features)
    assert_allclose(np.sinh(pairs[:, :, 0]) * PLAY_CM, [[0.0, 0.9], [-0.9, 0.0]], atol=1e-12)
    assert_allclose(pairs[:, :, 3], [[1.1, 1.1], [2.0, 2.0]])


@given(DISTANCES, DISTANCES, st.sampled_from(MOVES))
def test_both_tasks_mirrored_or_turned_are_the_same_pair(lesson, tested, move):
    moved = pair([lesson[side] for side in move], [tested[side] for side in move])
    assert_allclose(moved, pair(lesson, tested))


@given(DISTANCES)
def test_a_lesson_on_the_same_task_has_no_shift(lesson):
    assert_array_equal(pair(lesson, lesson)[:2], 0.0)


def test_records_from_before_the_choice_stay_those_of_the_encodings_of_then():
    assert name_in_records("difference", chosen=False) == name_in_records("difference", chosen=True) == ""
    assert name_in_records("concatenation", chosen=False) == ""  # Lego's
    named = [name_in_records(name, chosen=chosen) for name in ("walls", "concatenation") for chosen in (True, False)]
    assert named[:3] == ["walls", "walls", "concatenation"]


def test_tasks_without_walls_are_refused():
    with pytest.raises(ShapeError, match=r"encoding 'walls': needs the task features .* lack \['wall_left_cm'"):
        wall_pairs(("x", "y"), np.zeros((1, 2)), np.zeros((1, 2)))


@pytest.fixture(scope="module")
def fitted():
    """Skills that succeed where the wall of their lesson is as far, 60 tasks on a lattice."""
    rng = np.random.default_rng(0)
    features = rng.choice([1.1, 2.0, 2.9, 4.0], (60, 4))
    taught = np.arange(25)
    shift = wall_pairs(SIDES, features[taught], features)
    rate = np.where(np.abs(shift[..., 1]) < 0.01, 0.95, np.where(np.abs(shift[..., 0]) < 0.01, 0.5, 0.02))
    data = TransferData(
        names=tuple(map(str, range(60))),
        features=features,
        feature_names=SIDES,
        group=np.zeros(60, dtype=np.int64),
        train_task=taught,
        successes=rng.binomial(10, rate),
        draws=10,
        skills=np.zeros((25, 1)),
    )
    split = split_tasks(data, 0.2, 3, np.random.default_rng(1))
    options = FitOptions(hidden=32, epochs=60, members=3, patience=20)
    models = {
        encoding: fit(data, encoding, split, options, torch.Generator().manual_seed(0)).model
        for encoding in ("walls", "difference")
    }
    return data, rate, split, models


@pytest.mark.slow
def test_it_learns_in_which_wall_a_lesson_leans(fitted):
    data, rate, split, models = fitted
    new = np.flatnonzero(split.held_out)
    counts = data.successes[:, new].ravel()
    scores = {
        name: float(auc(model.predict(data.features[data.train_task], data.features[new]).ravel(), counts, data.draws))
        for name, model in models.items()
    }
    best = float(auc(rate[:, new].ravel(), counts, data.draws))
    assert scores["walls"] > best - 0.03
    assert scores["difference"] < scores["walls"] - 0.03


def test_logits_are_of_each_pair_alone(fitted):
    data, _, _, models = fitted
    model = models["walls"]
    assert model.weights["w1"].shape == (3, width("walls", 4), 32)
    table = model.predict(data.features[:7], data.features[:9])
    assert table.shape == (7, 9)
    one = [
        [model.predict(data.features[k : k + 1], data.features[m : m + 1])[0, 0] for m in range(9)] for k in range(7)
    ]
    assert_allclose(table, one, atol=1e-6)


def test_neighbours_are_neighbours_in_the_encoding(fitted):
    """With tasks turned by a quarter, the nearest pairs stay the nearest: their rates come back."""
    data, _, split, models = fitted
    turned = data.features[:, MOVES[2]]
    args = data, split, models["walls"]
    plain = baselines.nearest_neighbour(*args, data.features[:4], data.features[30:40], neighbours=1)
    same = baselines.nearest_neighbour(*args, turned[:4], turned[30:40], neighbours=1)
    assert_allclose(plain, same)


def test_a_round_trip_keeps_the_encoding_and_another_is_refused(fitted, tmp_path):
    data, _, _, models = fitted
    path = tmp_path / "model.safetensors"
    models["walls"].save(path, domain="insertion", config_hash="abc")
    loaded = load_transfer_model(path, feature_names=SIDES, encoding="walls")
    assert_array_equal(
        loaded.predict(data.features, data.features), models["walls"].predict(data.features, data.features)
    )
    with pytest.raises(ArtifactError, match="encoding walls; these tasks have difference"):
        load_transfer_model(path, feature_names=SIDES, encoding="difference")
