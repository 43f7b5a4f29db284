"""A person's features, trials and orders; one message for what is wrong with them."""

import io
from pathlib import Path

import numpy as np
import pytest

from p2l.errors import ArtifactError, InputError
from p2l.team import plan
from p2l.team.information import Stake
from p2l.team.shop import plan_shop
from p2l.team.shop.reading import read_shop
from p2l.team.transfer_files import LONG, check_output, transfer_text
from p2l.team.trial_files import read_features, read_orders, read_trials
from p2l.transfer.beliefs import BetaBelief
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
        ("task,mm\n", ("no tasks", "one row per task")),
        ("name,mm\na,1\n", ("column 'task'", "missing")),
        ("task\na\n", ("one cell only",)),
        ("task,mm,\na,1,2\n", ("row 1", "no name")),
        ("task,mm\na,1\na,2\n", ("row 3", "twice")),
        ("task,mm\n,1\n", ("row 2", "name it")),
        ("task,mm\na,1\nb,\n", ("row 3", "column 'mm'", "empty")),
        ("task,mm\na,1\nb,two\n", ("row 3", "column 'mm'", "'two'")),
        ("task,mm\na,1\nb,nan\n", ("row 3", "'nan'")),
        ("task,kind\na,x\nb,\n", ("row 3", "column 'kind'", "empty")),
        ("task;mm;kg\na;1,5;1\nb;2;2.5\n", ("row 3", "column 'kg'", "'2.5' has a decimal point")),
        ("task;mm;kg\na;1,234;1\nb;2;3\n", ("row 2", "may be 1234 or 1.234")),
        ("task,Famly,mm\na,x,1\n", ("column 'Famly'", "'family'")),
        ("task,mm\na,1\nb,1_0\n", ("row 3", "'1_0'")),
        ("task,mm\na,1,2\n", ("row 2", "3 cells")),
        ("task,mm,mm\na,1,2\n", ("twice",)),
        ("task,family\na,\n", ("row 2", "column 'family'")),
        ('task,mm\n"a,1\n', ("quote",)),
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


def as_a_workbook(text):
    openpyxl = pytest.importorskip("openpyxl")
    book, content = openpyxl.Workbook(), io.BytesIO()
    for line in text.splitlines():
        book.active.append([float(cell) if cell.lstrip("-")[:1].isdigit() else cell for cell in line.split(",")])
    book.save(content)
    return content.getvalue()


SPELLINGS = {
    "semicolons and decimal commas": lambda text: text.replace(",", ";").replace(".", ",").encode(),
    "byte order mark": lambda text: text.encode("utf-8-sig"),
    "UTF-16": lambda text: text.replace(",", "\t").encode("utf-16"),
    "Windows-1252": lambda text: text.replace("\n", "\r\n").encode("cp1252"),
    "sep=": lambda text: f"sep=;\r\n{text.replace(',', ';')}".encode(),
    "capitals and blank lines": lambda text: (text.split("\n")[0].upper() + "\n\n" + text.split("\n", 1)[1]).encode(),
    "workbook": as_a_workbook,
}


@pytest.mark.parametrize("spelling", SPELLINGS)
@pytest.mark.parametrize("by_standard_input", [False, True])
def test_any_spreadsheet_s_tables_say_the_same(tmp_path, monkeypatch, spelling, by_standard_input):
    def read(name, text, reader, *more):
        content = SPELLINGS[spelling](text)
        (tmp_path / name).write_bytes(content)
        if by_standard_input:
            monkeypatch.setattr("sys.stdin", io.TextIOWrapper(io.BytesIO(content)))
        return reader(Path("-") if by_standard_input else tmp_path / name, *more)

    features = "task,mm,family,kind,kg\nGröße,-8.5,p,x,0.1\nhole,9.5,p,y,1\nclip,3,c,x,2e3\n"
    tasks = read("features", features, read_features)
    assert tasks.names == ("Größe", "hole", "clip")
    assert [name.casefold() for name in (*tasks.numeric_names, *tasks.category_names)] == ["mm", "kg", "kind"]
    assert tasks.numeric.tolist() == [[-8.5, 0.1], [9.5, 1.0], [3.0, 2000.0]]
    assert (tasks.category[:, 0].tolist(), tasks.family.tolist()) == ([0, 1, 0], [1, 1, 0])
    rows = "taught,tested,successes,attempts\nGröße,hole,1,2\nclip,clip,0,1\nGröße,hole,1,1\n"
    trials = read("trials", rows, read_trials, tasks.names, Path("features.csv"))
    assert [trials.taught.tolist(), trials.tested.tolist()] == [[0, 2], [1, 2]]
    assert [trials.successes.tolist(), trials.attempts.tolist()] == [[2, 0], [3, 1]]
    day = "task,c_rob,c_hum,c_fail,c_demo,pretrained,count\nclip,1.5,2,3,never,0.5,2\nGröße,4,5,-,7,0,1\n"
    problem, place = read("orders", day, read_orders, tasks.names, Path("features.csv"), "fixed")
    assert (problem.tasks, place.tolist()) == (("clip", "clip (2)", "Größe"), [2, 2, 0])
    assert problem.c_rob.tolist() == [1.5, 1.5, 4.0]
    assert problem.c_fail.tolist() == [3.0, 3.0, np.inf]
    assert problem.c_demo.tolist() == [np.inf, np.inf, 7.0]


def test_a_feature_in_another_alphabet_s_minus_is_a_number(write):
    tasks = read_features(write("task,°C,code\na,−40,1.2.3\nb,+2,4\n".replace(",4\n", ",v4\n")))
    assert tasks.numeric.tolist() == [[-40.0], [2.0]]
    assert tasks.category_names == ("code",)


def test_orders_that_cannot_be_taught_have_no_lesson(write):
    text = "task,c_rob,c_hum,c_fail,c_demo,teachable,demo_success,decision\n"
    text += "peg,1,2,3,10,yes,50%,\nhole,1,2,3,10,no,,\nclip,1,2,3,10,yes,,!learn\n"
    problem, _ = read_orders(write(text), NAMES, Path("features.csv"), "fixed")
    assert problem.c_demo.tolist() == [20.0, np.inf, np.inf]  # a demonstration that teaches half the time: two


def test_what_orders_decide_is_decided_where_trials_are_valued_too(write):
    """The plan whose trials are valued is that of stage `plan`: copies, decisions, lessons that may not have taught."""
    head = "task,c_rob,c_hum,c_fail,c_demo,pretrained,count,decision,teachable,demo_success,demo_tries\n"
    kinds = [
        ",,,", "act,,,", "delegate,,,", "learn,,,", "!learn,,,", ",no,,", ",,80%,2", ",,50%,", "learn,,60%,1", "act,,,",
    ]  # fmt: skip
    for order, seed in (("fixed", 1), ("any", 2), ("fixed", 3)):
        rng = np.random.default_rng(seed)
        names = [f"t{i}" for i in range(len(kinds))]
        table = rng.uniform(0.0, 1.0, (10, 10)).round(3)
        rows = [
            f"{name},{rng.integers(1, 5)},{rng.integers(8, 20)},{rng.integers(5, 30)},{rng.integers(5, 25)},"
            f"{0.2 * rng.random():.3f},{rng.integers(1, 4)},{kind}\n"
            for name, kind in zip(names, rng.permutation(kinds), strict=True)
        ]
        orders = write(head + "".join(rows), "orders.csv")
        lines = [",".join([name, *map(str, row)]) for name, row in zip(names, table.tolist(), strict=True)]
        square = write("\n".join([",".join(["task", *names]), *lines]) + "\n", "square.csv")
        problem, place = read_orders(orders, names, Path("features.csv"), order)
        belief = BetaBelief(1e3 * table.ravel() + 1e-9, 1e3 * (1.0 - table.ravel()) + 1e-9)
        valued = plan(Stake(problem, place, belief, 10).today)
        assert valued.objective == pytest.approx(plan_shop(read_shop(orders, square, order=order).shop).objective)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("taught,tested,successes\npeg,hole,1\n", ("columns", "expected taught,tested,successes,attempts or")),
        ("taught,tested,success,note\npeg,hole,1,x\n", ("note",)),
        ("taught,tested,success\npeg,lid,1\n", ("row 2", "column 'tested'", "'lid' is not in features.csv")),
        ("taught,tested,success\npeg,hole,maybe\n", ("row 2", "'maybe'", "neither yes nor no")),
        ("taught,tested,successes,attempts\npeg,hole,3,2\n", ("row 2", "3 of 2")),
        ("taught,tested,successes,attempts\npeg,hole,0,0\n", ("column 'attempts'", "'0'")),
        ("taught,tested,success\n", ("no trials",)),
        ("taught,tested,success\npeg,holes,1\n", ("is it 'hole'?",)),
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
        ("peg,1,2,3,4,0,p,1\npeg,1,2,3,4,0,p,1\n", ("row 3", "column 'task'", "twice")),
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
