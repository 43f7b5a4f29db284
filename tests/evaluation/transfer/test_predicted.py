"""The figure of a predicted table: names on both axes where there is room, a ring on each tried pair."""

import numpy as np
import pytest

from p2l.evaluation.transfer.predicted import prediction_figure
from p2l.transfer.few_trials import Prior, TaskTable, Trials
from p2l.transfer.pair_models import FitSetting
from p2l.transfer.prediction import predict


@pytest.mark.parametrize(("m", "pairs", "named"), [(2, 0, True), (25, 30, True), (60, 200, True), (90, 10, False)])
def test_a_table_of_any_size_is_drawn(m, pairs, named):
    rng = np.random.default_rng(0)
    names = tuple(f"a task with $ a rather long name {number}" for number in range(m))
    tasks = TaskTable(names, ("x",), rng.normal(size=(m, 1)), (), np.zeros((m, 0), dtype=np.int64), np.arange(m) % 4)
    taught, tested = np.divmod(rng.choice(m * m, pairs, replace=False), m)
    trials = Trials(taught, tested, np.ones(pairs, dtype=np.int64), np.full(pairs, 2))
    prediction = predict(FitSetting(tasks, Prior()), trials, ("rates",), 2, 10**6, 0.9, rng=rng)
    figure = prediction_figure(prediction, 0.9)
    figure.canvas.draw()
    left, right = figure.axes[:2]
    assert left.get_xlabel() == "tested task"
    assert "taught task" in left.get_ylabel()
    assert right.get_title() == "width of the 90% interval"
    shown = [label.get_text() for label in left.get_yticklabels()]
    assert (shown == ["a task with $ a r…"] * m) == named
    if pairs:
        np.testing.assert_array_equal(left.collections[0].get_offsets(), np.column_stack([tested, taught]))
    else:
        assert not left.collections
