"""Records of tasks, trials and pairs: hand-computed features, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from p2l.errors import ShapeError
from p2l.transfer.few_trials import OTHER, SAME_FAMILY, SAME_TASK, Prior, TaskTable, Trials, all_pairs, pairs_of

NUMBERS = np.array([[1.0, 2.0, 7.0], [3.0, 20.0, 7.0], [5.0, 200.0, 7.0]])
TASKS = TaskTable(
    ("a", "b", "c"), ("x", "y", "z"), NUMBERS, ("material",), np.array([[0], [0], [1]]), np.array([0, 0, 1])
)


def test_features_are_standardised_wide_ones_by_their_logarithm_and_constant_ones_left_out():
    expected = np.array([-1.0, 0.0, 1.0]) * np.sqrt(1.5)
    np.testing.assert_allclose(TASKS.standardised, np.column_stack([expected, expected]), atol=1e-12)


def test_a_pair_has_signed_differences_and_what_is_the_same():
    pairs = pairs_of(TASKS, np.array([0, 1, 2]), np.array([0, 0, 1]))
    np.testing.assert_allclose(pairs.signed[:, 0], np.array([0.0, -1.0, -1.0]) * np.sqrt(1.5), atol=1e-12)
    np.testing.assert_allclose(pairs.size, np.abs(pairs.signed))
    assert pairs.same.tolist() == [[1.0, 1.0, 1.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]]
    assert pairs.group.tolist() == [SAME_TASK, SAME_FAMILY, OTHER]
    assert pairs.linear.shape == pairs.differences.shape == (3, 7)


def test_excess_is_zero_on_average_over_different_tasks_and_for_a_task_and_itself():
    pairs = all_pairs(TASKS)
    itself = pairs.taught == pairs.tested
    np.testing.assert_allclose(pairs.excess[~itself].mean(axis=0), 0.0, atol=1e-12)
    assert (pairs.excess[itself] == 0.0).all()


def test_without_families_different_tasks_are_all_of_one_kind():
    tasks = TaskTable(TASKS.names, TASKS.numeric_names, NUMBERS, TASKS.category_names, TASKS.category)
    pairs = all_pairs(tasks)
    assert set(pairs.group[pairs.taught != pairs.tested]) == {OTHER}
    assert pairs.same.shape == (9, 2)
    assert Prior().of_groups(has_family=False).tolist() == pytest.approx([0.9, 0.35, 0.35])


ROWS = st.lists(st.tuples(st.integers(0, 3), st.integers(0, 3), st.integers(0, 4), st.integers(0, 4)), min_size=1)


@given(ROWS)
def test_pooled_trials_are_the_sums_of_each_pair_in_any_order(rows):
    expected = {}
    for i, j, wins, losses in rows:
        s, n = expected.get((i, j), (0, 0))
        expected[i, j] = s + wins, n + wins + losses + 1
    columns = np.array([(i, j, wins, wins + losses + 1) for i, j, wins, losses in rows]).T
    for order in (slice(None), slice(None, None, -1)):
        pooled = Trials.pooled(*columns[:, order])
        pairs = zip(pooled.taught.tolist(), pooled.tested.tolist(), strict=True)
        counts = zip(pooled.successes.tolist(), pooled.attempts.tolist(), strict=True)
        assert dict(zip(pairs, counts, strict=True)) == expected


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (([0], [1], [2], [1]), "exceed"),
        (([0], [1], [0], [0]), "at least 1"),
        (([0, 0], [1, 1], [0, 0], [1, 1]), "twice"),
        (([0], [1], [0], [1, 1]), "length"),
    ],
)
def test_impossible_trials_are_refused(columns, message):
    with pytest.raises(ShapeError, match=message):
        Trials(*(np.array(column) for column in columns))


@pytest.mark.parametrize("change", [{"other": 0.0}, {"same_task": 1.0}, {"pseudo_count": 0.0}])
def test_a_prior_that_no_trial_could_change_is_refused(change):
    with pytest.raises(ShapeError, match=next(iter(change))):
        Prior(**change)
