"""Figures hold a line, bar or mark for each thing they speak of, and their bytes depend on the data alone."""

import numpy as np
import pytest

from p2l.evaluation.style import METHODS, THESIS_METHODS, png, spread
from p2l.evaluation.team.figures import PARTS, cost_by_method, cost_by_pretraining
from p2l.evaluation.team.layouts import board_plans, environments
from p2l.evaluation.team.overview import overview
from p2l.evaluation.transfer.maps import block_ticks, task_order, transfer_maps
from p2l.records import TransferData
from tests.evaluation.team.team_results import plans, results, study, summary

PANELS = {"low_teaching": "cheap", "high_teaching": "dear"}


def lines(axes):
    return {line.get_label(): line for line in axes.lines if line.get_gid() == "labelled"}


def test_each_method_has_one_colour_of_its_own():
    assert len({style.colour for style in METHODS.values()}) == len(METHODS)
    assert len({style.marker for style in METHODS.values()}) == len(METHODS)


def test_cost_lines_carry_the_means_of_every_method_and_their_names():
    figure = cost_by_pretraining(summary(study()), PANELS, "3 sets")
    above, below = figure.axes[:2], figure.axes[2:]
    for axes in (*above, *below):
        assert set(lines(axes)) == {METHODS[method].label for method in THESIS_METHODS}
        assert {text.get_text() for text in axes.texts} == set(lines(axes))
    assert lines(above[1])["AD"].get_ydata().tolist() == [1000.0, 900.0]
    assert lines(below[1])["AD"].get_ydata().tolist() == [100.0, 0.0]
    assert lines(below[1])["ADL"].get_ydata().tolist() == [0.0, 0.0]
    dashed = [line for line in above[0].lines if line.get_gid() != "labelled"]
    assert len(dashed) == len(THESIS_METHODS)
    assert all("units of effort" in axes.get_ylabel() for axes in (above[0], below[0]))


def test_methods_that_did_not_run_have_no_line():
    frame = study()
    figure = cost_by_pretraining(summary(frame[frame["method"] != "cba_best"]), PANELS, "3 sets")
    assert METHODS["cba_best"].label not in lines(figure.axes[0])
    assert len(lines(figure.axes[0])) == len(THESIS_METHODS) - 1


def test_bars_add_up_to_the_executed_cost():
    frame = results({method: [100.0, 300.0] for method in THESIS_METHODS})
    frame = frame.assign(attempts=5.0, failures=1.0, delegated=0.5, demos=0.5)
    costs = {"c_rob": 10.0, "c_fail": 50.0, "c_hum": 100.0, "c_demo": 100.0}
    axes = cost_by_method(frame, costs, {"adl": 180.0}, "title").axes[0]
    bars = [
        container for container in axes.containers if len(container.patches if hasattr(container, "patches") else ())
    ]
    assert len(bars) == len(PARTS)
    tops = [bar.get_y() + bar.get_height() for bar in bars[-1]]
    assert tops == pytest.approx([200.0] * len(THESIS_METHODS))
    assert [label.get_text() for label in axes.get_xticklabels()] == [
        METHODS[method].label for method in THESIS_METHODS
    ]
    assert axes.collections[-1].get_offsets()[:, 1].tolist() == [180.0]


def test_the_board_shows_each_order_with_17_holes_and_one_arrow_per_attempt_a_lesson_serves():
    rows = plans("board", sets=2)
    figure = board_plans(rows[rows["method"] == "adl"], ["order 1", "order 2"])
    assert [axes.get_title() for axes in figure.axes[:2]] == ["order 1", "order 2"]
    for axes in figure.axes[:2]:
        assert {text.get_text() for text in axes.texts} == {"5 cm", *map(str, range(17))}
        assert sum(type(patch).__name__ == "FancyArrowPatch" for patch in axes.patches) == 1


def test_environments_show_all_walls():
    figure = environments(0, 2.0)
    assert len(figure.axes) == 4
    for axes, count in zip(figure.axes, (6, 9, 12, 15), strict=True):
        assert len(axes.patches) == count
        assert f"{count} walls" in axes.get_title()


def test_the_overview_names_its_decisions():
    rows = plans("high_teaching", names=("7", "8", "12"))
    day = rows[(rows["method"] == "adl") & (rows["set"] == 0)]
    figure = overview(day, day, summary(study(regimes=("high_teaching",))))
    assert "1 × act, 1 × delegate, 1 × learn" in figure.axes[0].get_title()
    assert len(figure.axes[0].lines) == 1


def test_like_tasks_lie_together_in_a_transfer_map():
    names = ("wall_left_cm", "wall_right_cm", "wall_bottom_cm", "wall_top_cm")
    far = 4.0
    features = np.array([[far, far, 1.0, far], [2.0, far, far, far], [far, far, 0.5, far], [1.0, far, far, far]])
    data = TransferData(
        ("a", "b", "c", "d"), features, names, np.zeros(4), np.array([0]), np.ones((1, 4)), 1, np.zeros((1, 2))
    )
    order, kinds = task_order(data)
    assert order.tolist() == [3, 1, 2, 0]
    assert kinds == ["left wall", "left wall", "bottom wall", "bottom wall"]
    ticks = block_ticks(kinds)
    assert ticks == [(0.5, "left wall"), (2.5, "bottom wall")]
    figure = transfer_maps({"simulated": data.rate, "predicted": data.rate}, "taught", "tested", [], ticks)
    assert [axes.get_title() for axes in figure.axes[:2]] == ["simulated", "predicted"]


def test_tasks_without_walls_are_ordered_by_group():
    data = TransferData(
        ("u/0", "l/0", "u/1"),
        np.zeros((3, 1)),
        ("width",),
        np.array([1, 0, 1]),
        np.array([0]),
        np.ones((1, 3)),
        1,
        np.zeros((1, 1)),
    )
    order, kinds = task_order(data)
    assert order.tolist() == [1, 0, 2]
    assert kinds == ["l", "u", "u"]


@pytest.mark.parametrize(
    ("wanted", "found"),
    [
        ([0.0, 10.0], [0.0, 10.0]),
        ([5.0, 5.0], [4.5, 5.5]),
        ([0.0, 0.0, 0.0], [-1.0, 0.0, 1.0]),
        ([3.0], [3.0]),
        ([], []),
    ],
)
def test_labels_move_apart_as_little_as_possible(wanted, found):
    assert spread(np.array(wanted), 1.0).tolist() == pytest.approx(found)


def test_two_drawings_have_the_same_bytes():
    def draw():
        return png(cost_by_pretraining(summary(study()), PANELS, "3 sets"))

    first = draw()
    assert first == draw()
    assert b"Software" not in first
    assert b"Creation Time" not in first
