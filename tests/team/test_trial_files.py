"""A person's features, trials and orders; one message for what is wrong with them."""

from pathlib import Path

import numpy as np
import pytest

from p2l.errors import ArtifactError, InputError
from p2l.team.transfer_files import LONG, check_output, transfer_text
from p2l.team.trial_files import read_features, read_orders, read_trials
from p2l.transfer.few_trials import Prior, Trials
from p2l.transfer.pair_models import FitSetting
from p2l.transfer.prediction import predict

FEATURES = "task,mm,family,material,kg\npeg,8,p,steel,1\nhole,9.5,p,wood,2\nclip,3,c,steel,1e-1\n"
NAMES = ("peg", "hole", "clip")


@pytest.fixture
def write(tmp_path):
    def save(text, name="file.csv"):
        path = tmp_path / name
        path.write_text(text, encoding="utf-8")
        return path

    return save


def test_columns_of_numbers_and_of_words_are_told_apart(write):
    tasks = read_features(write("\ufeff" + FEATURES + "\n"))
    assert (tasks.names, tasks.numeric_names, tasks.category_names) == (NAMES, ("mm", "kg"), ("material",))
    assert tasks.numeric.tolist() == [[8.0, 1.0], [9.5, 2.0], [3.0, 0.1]]
    assert tasks.category[:, 0].tolist() == [0, 1, 0]
    assert tasks.family.tolist() == [1, 1, 0]
    assert read_features(write("task,family\na,x\nb,x\n")).numeric.shape == (2, 0)
    assert read_features(write("task,mm\na,1\n")).family is None


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ("empty",)),
        ("task,mm\n", ("at least one row",)),
        ("name,mm\na,1\n", ("column 'task'", "missing")),
        ("task\na\n", ("no features",)),
        ("task,mm\na,1\na,2\n", ("row 3", "twice")),
        ("task,mm\n,1\n", ("row 2", "name it")),
        ("task,mm\na,1\nb,\n", ("row 3", "column 'mm'", "empty")),
        ("task,mm\na,1\nb,two\n", ("row 3", "column 'mm'", "'two'")),
        ("task,mm\na,1\nb,nan\n", ("row 3", "'nan'")),
        ("task,mm\na,1\nb,1_0\n", ("row 3", "'1_0'")),
        ("task,mm\na,1,2\n", ("row 2", "3 cells")),
        ("task,mm,mm\na,1,2\n", ("twice",)),
        ("task,family\na,\n", ("row 2", "column 'family'")),
        ('task,mm\n"a,1\n', ("CSV",)),
    ],
)
def test_wrong_features_are_told_in_one_message(write, text, parts):
    path = write(text)
    with pytest.raises(InputError) as caught:
        read_features(path)
    for part in (str(path), *parts):
        assert part in str(caught.value)


def test_both_forms_of_trials_say_the_same(write):
    counts = write("taught,tested,successes,attempts\npeg,hole,1,2\nclip,clip,0,1\npeg,hole,1,1\n")
    single = write("success,taught,tested\nyes,peg,hole\n0,peg,hole\nFalse,clip,clip\nTRUE,peg,hole\n", "single.csv")
    for path in (counts, single):
        trials = read_trials(path, NAMES, Path("features.csv"))
        rows = (trials.taught, trials.tested, trials.successes, trials.attempts)
        assert np.array(rows).T.tolist() == [[0, 1, 2, 3], [2, 2, 0, 1]]


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("taught,tested,successes\npeg,hole,1\n", ("columns", "expected taught,tested,successes,attempts or")),
        ("taught,tested,success,note\npeg,hole,1,x\n", ("note",)),
        ("taught,tested,success\npeg,lid,1\n", ("row 2", "column 'tested'", "'lid' is not in features.csv")),
        ("taught,tested,success\npeg,hole,maybe\n", ("row 2", "'maybe'", "yes or no")),
        ("taught,tested,successes,attempts\npeg,hole,3,2\n", ("row 2", "3 of 2")),
        ("taught,tested,successes,attempts\npeg,hole,0,0\n", ("column 'attempts'", "'0'")),
        ("taught,tested,successes,attempts\npeg,hole,-1,2\n", ("'-1'", "whole number")),
        ("taught,tested,successes,attempts\npeg,hole,1.5,2\n", ("'1.5'",)),
        ("taught,tested,successes,attempts\npeg,hole,²,2\n", ("'²'",)),
    ],
)
def test_wrong_trials_are_told_in_one_message(write, text, parts):
    with pytest.raises(InputError) as caught:
        read_trials(write(text), NAMES, Path("features.csv"))
    for part in parts:
        assert part in str(caught.value)


ORDERS = "task,c_rob,c_hum,c_fail,c_demo,pretrained,family,count\n"


def test_a_task_that_comes_twice_has_two_rows_of_one_task(write):
    path = write(ORDERS + "clip,1,2,3,,0.5,c,2\npeg,4,5,inf,7,0,p,1\n")
    problem, place = read_orders(path, NAMES, Path("features.csv"), "any")
    assert problem.tasks == ("clip", "clip (2)", "peg")
    assert place.tolist() == [2, 2, 0]
    assert problem.c_demo.tolist() == [np.inf, np.inf, 7.0]
    assert problem.pretrained.tolist() == [0.5, 0.5, 0.0]
    assert problem.order == "any"


@pytest.mark.parametrize(
    ("rows", "parts"),
    [
        ("lid,1,2,3,4,0,p,1\n", ("'lid' is not in features.csv",)),
        ("peg,1,2,3,4,0,p,1\npeg,1,2,3,4,0,p,1\n", ("row 3", "count")),
        ("peg,-1,2,3,4,0,p,1\n", ("column 'c_rob'", "'-1'")),
        ("peg,1,2,3,4,1.5,p,1\n", ("column 'pretrained'", "'1.5'")),
        ("peg,1,2,3,4,0,p,0\n", ("column 'count'", "'0'")),
        ("peg,inf,inf,3,inf,0,p,1\n", ("'peg' cannot be done",)),
    ],
)
def test_wrong_orders_are_told_in_one_message(write, rows, parts):
    with pytest.raises(InputError) as caught:
        read_orders(write(ORDERS + rows), NAMES, Path("features.csv"), "fixed")
    for part in parts:
        assert part in str(caught.value)


def test_a_table_in_both_forms_holds_the_same_numbers(write):
    tasks = read_features(write(FEATURES.replace("peg", "=peg")))
    trials = Trials(*(np.array([each]) for each in (0, 1, 3, 4)))
    prediction = predict(FitSetting(tasks, Prior()), trials, ("gp",), 2, 15, 0.9, rng=np.random.default_rng(0))
    long = [line.split(",") for line in transfer_text(prediction, "long").splitlines()]
    square = [line.split(",") for line in transfer_text(prediction, "square").splitlines()]
    assert tuple(long[0]) == LONG
    assert [row[0] for row in square] == ["task", "'=peg", "hole", "clip"]  # no spreadsheet runs it
    assert [cell for row in square[1:] for cell in row[1:]] == [row[2] for row in long[1:]]
    assert long[2][:2] == ["'=peg", "hole"]
    assert long[2][5:] == ["4", "3", "'=peg>hole:3/4"]
    assert all(float(low) < float(p) < float(high) for _, _, p, low, high, *_ in long[1:])


def test_a_table_is_written_over_nothing_but_a_table(write, tmp_path):
    features, other = write(FEATURES, "features.csv"), write("taught,when\n", "other.csv")
    for path, part in ((features, "is an input"), (other, "no transfer table"), (tmp_path, "is a folder")):
        with pytest.raises(ArtifactError, match=part):
            check_output(path, (features, None))
    with pytest.raises(ArtifactError, match="no folder"):
        check_output(tmp_path / "none" / "t.csv", (features,))
    check_output(write(",".join(LONG) + "\n", "old.csv"), (features,))
    check_output(tmp_path / "new.csv", (features, None))
