"""Records check their shapes and ranges at birth and cannot be changed afterwards."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from p2l.errors import ShapeError
from p2l.records import TransferData, freeze


def transfer_data(**changes):
    fields = {
        "names": ("a", "b", "c"),
        "features": np.zeros((3, 2)),
        "feature_names": ("x_cm", "y_cm"),
        "group": np.array([0, 0, 1]),
        "train_task": np.array([2, 0]),
        "successes": np.array([[0, 1, 4], [4, 2, 0]]),
        "draws": 4,
        "skills": np.array([[1.0, np.nan], [1.0, 2.0]]),
    }
    return TransferData(**{**fields, **changes})


def test_rates_are_successes_over_draws():
    np.testing.assert_allclose(transfer_data().rate, [[0, 0.25, 1], [1, 0.5, 0]])


def test_a_record_survives_its_arrays():
    data = transfer_data()
    again = TransferData.from_arrays(data.arrays())
    assert (again.names, again.feature_names, again.draws) == (data.names, data.feature_names, data.draws)
    for name in ("features", "group", "train_task", "successes", "skills"):
        np.testing.assert_array_equal(getattr(again, name), getattr(data, name))


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"features": np.zeros((4, 2))}, "features"),
        ({"features": np.array([[0, np.nan]] * 3)}, "NaN"),
        ({"group": np.zeros(3) + 0.5}, "whole"),
        ({"train_task": np.array([3, 0])}, "train_task"),
        ({"successes": np.array([[0, 1, 5], [4, 2, 0]])}, "at most 4"),
        ({"successes": -np.ones((2, 3))}, "at least 0"),
        ({"draws": 0}, "draws"),
        ({"skills": np.zeros((3, 2))}, "K = 2"),
        ({"names": ("a", "b")}, "M = 2"),
    ],
)
def test_a_wrong_field_is_named(changes, word):
    with pytest.raises(ShapeError, match=word):
        transfer_data(**changes)


def test_arrays_are_read_only_copies():
    given_features = np.zeros((3, 2))
    data = transfer_data(features=given_features)
    given_features[0, 0] = 7
    assert data.features[0, 0] == 0
    with pytest.raises(ValueError, match="read-only"):
        data.features[0, 0] = 1


@given(hnp.arrays(np.float64, hnp.array_shapes(min_dims=1, max_dims=3, max_side=4), elements=st.floats(-5, 5)))
def test_freeze_accepts_exactly_what_is_in_range(value):
    letters = tuple("ABC"[: value.ndim])
    inside = bool(((value >= -1) & (value <= 1)).all())
    if inside:
        np.testing.assert_array_equal(freeze("v", value, letters, {}, low=-1, high=1), value)
    else:
        with pytest.raises(ShapeError):
            freeze("v", value, letters, {}, low=-1, high=1)


def test_text_is_not_a_number():
    with pytest.raises(ShapeError, match="expected numbers"):
        freeze("cost", ["cheap"], ("N",), {})
