"""Tables and figures of chapter 5 on data made by hand."""

import numpy as np
import pandas as pd
import pytest

from p2l.evaluation.chaining.figures import learning_curves, option_counts
from p2l.evaluation.chaining.tables import Learning, figure_5_5, figure_5_8, steps_to_thesis, table_5_1
from p2l.evaluation.statistics import wilson_interval
from p2l.evaluation.thesis import load_thesis


@pytest.fixture(scope="module")
def thesis():
    return load_thesis("data/thesis", 5)


def episodes(learner, seed, nominal, flagged, recovered):
    """`nominal` successes, then `flagged` failures of which the first `recovered` are recovered."""
    count = nominal + flagged
    done = np.arange(count) < nominal
    rows = {
        "episode": np.arange(count),
        "nominal": done,
        "flagged": ~done,
        "success": np.arange(count) < nominal + recovered,
    }
    return pd.DataFrame(rows).assign(
        learner=learner, whole_task=learner == "rl", seed=seed, diverged=False, steps=10, actions=""
    )


def cell(table, method, metric, setting="world=pick_place"):
    rows = table[(table["method"] == method) & (table["metric"] == metric) & (table["setting"] == setting)]
    return rows.iloc[0]


@pytest.fixture(scope="module")
def made(thesis):
    parts = [episodes("rc", 0, 6, 4, 4), episodes("rc", 1, 8, 2, 1), episodes("rl", 0, 0, 10, 1)]
    return table_5_1({"pick_place": pd.concat(parts, ignore_index=True)}, thesis)


def test_overall_success_counts_trainings_and_the_seeds_are_kept_apart(made):
    over = cell(made, "rc", "success")
    assert (over["mean"], over["n"], over["thesis"]) == (pytest.approx(0.95), 2, 0.9)
    assert (over["low"], over["high"]) == (pytest.approx(0.95 - 12.7062047 * 0.05), 1.0)  # t of 100 and 90 %
    assert cell(made, "rc", "recovery")["mean"] == pytest.approx((4 / 4 + 1 / 2) / 2)
    nominal = cell(made, "nominal", "success")  # no training changes it
    assert (nominal["n"], nominal["low"]) == (20, float(wilson_interval(14, 20)[0]))
    second = cell(made, "rc", "success", "world=pick_place;seed=1")
    assert (second["mean"], second["n"]) == (9 / 10, 10)
    assert cell(made, "rc", "recovery", "world=pick_place;seed=1")["mean"] == 0.5
    assert cell(made, "nominal", "success", "world=pick_place;seed=0")["mean"] == 0.6
    assert cell(made, "nominal", "success")["mean"] == 14 / 20
    assert cell(made, "rl", "success")["mean"] == 0.1
    assert "recovery" not in set(made[made["method"] == "rl"]["metric"]), "it takes nothing over"


def test_learners_are_compared_with_rc_on_the_same_starts(thesis):
    parts = [episodes("rc", 0, 6, 4, 3), episodes("rc", 1, 8, 2, 1), episodes("rc", 2, 5, 5, 5)]
    parts += [episodes("lazy_rc", 0, 6, 4, 1), episodes("lazy_rc", 1, 8, 2, 2), episodes("rl", 0, 0, 10, 1)]
    broken = parts[3].assign(diverged=parts[3]["episode"] == 9)  # lost by RC as well
    table = table_5_1({"pick_place": pd.concat([*parts[:3], broken, *parts[4:]], ignore_index=True)}, thesis)
    lazy = cell(table, "lazy_rc", "success_minus_rc")
    first = 7 / 9 - 9 / 9  # of the nine that are sound
    assert (lazy["mean"], lazy["n"]) == (pytest.approx((first + 0.1) / 2), 2)
    half = 12.7062047 * abs(first - 0.1) / 2  # Student's quantile of one degree of freedom
    assert (lazy["low"], lazy["high"]) == (pytest.approx(lazy["mean"] - half), pytest.approx(lazy["mean"] + half))
    flat = cell(table, "rl", "success_minus_rc")
    assert (flat["mean"], flat["n"]) == (pytest.approx(-0.8), 1)
    assert np.isnan(flat["low"]), "one pair says nothing of what differs between seeds"
    assert not len(table[(table["method"] == "rc") & (table["metric"] == "success_minus_rc")])


def test_what_trainings_were_given_stands_beside_their_success(thesis):
    """RC revisits a quarter and a half of its episodes; what a lazy learner spares is a share of its budget."""
    counts = {("rc", 0): (90, 30, 0), ("rc", 1): (50, 50, 0), ("lazy_rc", 0): (100, 0, 100), ("rl", 0): (10, 0, 0)}
    trainings = []
    for (learner, seed), (ended, revisited, spared) in counts.items():
        rounds = pd.DataFrame(
            {"ended": [ended - 5, 5], "revisited": [0, revisited], "control_steps": [10, 400], "spared": [0, spared]}
        )
        trainings.append(Learning(learner, seed, rounds, pd.DataFrame()))
    parts = [episodes("rc", 0, 6, 4, 3), episodes("rc", 1, 8, 2, 1), episodes("lazy_rc", 0, 6, 4, 1)]
    parts.append(episodes("rl", 0, 0, 10, 1))
    table = table_5_1({"pick_place": pd.concat(parts)}, thesis, {"pick_place": trainings})
    assert cell(table, "rc", "revisited")["mean"] == pytest.approx((0.25 + 0.5) / 2)
    assert cell(table, "rc", "revisited", "world=pick_place;seed=1")["mean"] == 0.5
    assert cell(table, "lazy_rc", "revisited")["mean"] == cell(table, "rl", "revisited")["mean"] == 0.0
    assert cell(table, "lazy_rc", "spared")["mean"] == pytest.approx(100 / 500)
    assert cell(table, "lazy_rc", "control_steps")["mean"] == 400.0
    early = [Learning("rc", 0, trainings[0].rounds.drop(columns="spared"), pd.DataFrame())]
    assert "spared" not in set(table_5_1({"pick_place": parts[0]}, thesis, {"pick_place": early})["metric"])


def run(learner, seed, *points, chosen=((3, 1), (0, 5))):
    evaluations = pd.DataFrame(points, columns=["control_steps", "success"])
    rounds = pd.DataFrame(chosen, columns=["chosen:from pick", "chosen:from place"])
    return Learning(learner, seed, rounds.assign(control_steps=range(len(chosen))), evaluations)


@pytest.fixture(scope="module")
def runs():
    return {"pick_place": [run("rc", 1, (0, 0.0), (100, 0.8)), run("rc", 0, (0, 0.0), (50, 0.2), (100, 0.6))]}


def test_curves_hold_the_last_evaluation_so_far(runs, thesis):
    table = figure_5_5(runs, thesis, points=3)
    half = cell(table, "rc", "success", "world=pick_place;control_steps=50")
    assert (half["mean"], half["n"]) == (0.1, 2)
    assert cell(table, "rc", "success", "world=pick_place;control_steps=100")["mean"] == pytest.approx(0.7)
    assert cell(table, "rc", "success", "world=pick_place;seed=0;control_steps=50")["mean"] == 0.2
    assert cell(table, "rc", "success", "world=pick_place;seed=1;control_steps=100")["mean"] == 0.8
    assert len(learning_curves(table).axes) == 1


def test_a_curve_begins_where_all_its_runs_have_been_evaluated(thesis):
    """A search has no policy before its first rounds."""
    late = {"pick_place": [run("search", 0, (40, 0.5), (100, 0.8)), run("search", 1, (60, 0.7), (100, 0.8))]}
    table = figure_5_5(late, thesis, points=2)
    assert cell(table, "search", "success", "world=pick_place;control_steps=60")["mean"] == pytest.approx(0.6)
    means = [setting for setting in table["setting"] if "seed" not in setting]
    assert means == ["world=pick_place;control_steps=60", "world=pick_place;control_steps=100"]


def test_options_are_counted_by_round(runs, thesis):
    table = figure_5_8(runs, thesis)
    assert cell(table, "rc", "place", "world=pick_place;round=1")["mean"] == 5.0
    assert cell(table, "rc", "pick", "world=pick_place;round=0")["mean"] == 3.0
    assert cell(table, "rc", "place", "world=pick_place;round=1;seed=0")["mean"] == 5.0
    assert len(option_counts(table, "pick_place").axes[0].lines) == 2


def test_steps_to_the_thesis_are_those_of_the_first_two_evaluations_that_are_good_enough(made, thesis):
    """0.9 overall with 0.7 nominal asks for 2 / 3 of the failures; once alone is luck."""
    lucky = run("rc", 0, (0, 0.0), (50, 0.7), (100, 0.6), (150, 0.7))
    steady = run("rc", 1, (0, 0.0), (50, 0.6), (100, 0.7), (150, 0.8))
    flat = run("rl", 0, (0, 0.0), (50, 0.0))  # the thesis's never does the task, which is nothing to reach
    table = steps_to_thesis(made, {"pick_place": [lucky, steady, flat]}, thesis)
    assert cell(table, "rc", "reached")["mean"] == 0.5
    assert cell(table, "rc", "control_steps")["mean"] == (150 + 100) / 2
    assert cell(table, "rc", "control_steps")["low"] == 0.0, "no run takes less than nothing"
    assert cell(table, "rc", "ratio")["mean"] == pytest.approx(125.0 / 500_000)
    assert set(table["method"]) == {"rc"}


def test_a_learner_that_the_thesis_does_not_have_is_held_against_its_rc(made, thesis):
    more = made[made["method"] == "rc"].assign(method="search")
    found = run("search", 0, (10, 0.5), (20, 0.7), (30, 0.7))
    table = steps_to_thesis(pd.concat([made, more]), {"pick_place": [found]}, thesis)
    assert cell(table, "search", "control_steps")["mean"] == 20
    assert cell(table, "search", "reached")["mean"] == 1.0
