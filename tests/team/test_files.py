import csv
import dataclasses
import json
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from p2l.errors import ArtifactError, ConfigError, InputError, ShapeError, SolverError
from p2l.team import Decision, plan
from p2l.team.cells import Sheet, probability
from p2l.team.certificate import check_certificate
from p2l.team.columns import probabilities
from p2l.team.files import read_problem
from p2l.team.plan_files import explain, read_plan, write_plan
from tests.team.team_instances import random_transfer, thesis_set

ORDERS = "task,c_rob,c_hum,c_fail,c_demo,pretrained\ncup,10,100,100,200,0\nlid,10,100,100,200,0.5\nbox,1e1,90,80,70,1\n"
TRANSFER = ",box,cup,lid\nlid,0.1,0.2,1\ncup,0.3,1,0.4\nbox,1,0.5,0.6\n"


def files(tmp_path, orders=ORDERS, transfer=TRANSFER):
    (tmp_path / "orders.csv").write_text(orders, encoding="utf-8")
    (tmp_path / "transfer.csv").write_text(transfer, encoding="utf-8")
    return tmp_path / "orders.csv", tmp_path / "transfer.csv"


def test_rows_and_columns_of_the_table_may_come_in_any_order(tmp_path):
    problem = read_problem(*files(tmp_path), "any")
    assert problem.tasks == ("cup", "lid", "box")
    assert problem.order == "any"
    assert problem.c_hum.tolist() == [100, 100, 90]
    assert problem.pretrained.tolist() == [0, 0.5, 1]
    assert read_problem(*files(tmp_path, ORDERS.replace("200,0.5", "200,"))).pretrained.tolist() == [0, 0, 1]
    assert problem.transfer.tolist() == [[1, 0.4, 0.3], [0.2, 1, 0.1], [0.5, 0.6, 1]]


def test_spreadsheet_habits_are_understood(tmp_path):
    orders = (
        '\ufeffc_demo, task ,c_rob,c_hum,c_fail\r\n200, cup ,10,100,100\r\n\r\n200,"lid, red",10,100,100\r\n,,,,\r\n'
    )
    transfer = 'taught,cup,"lid, red"\r\ncup,1,0.5\r\n"lid, red",0.25,1\r\n'
    problem = read_problem(*files(tmp_path, orders, transfer))
    assert problem.tasks == ("cup", "lid, red")
    assert problem.pretrained.tolist() == [0, 0]
    assert problem.transfer[1, 0] == 0.25


@pytest.mark.parametrize(
    ("orders", "transfer"),
    [
        (ORDERS.replace("c_rob", "C Rob").replace("c_", "C-").replace("task", "TASK"), TRANSFER),
        (ORDERS.replace(",", ";"), TRANSFER.replace(",", "\t")),
        (ORDERS.replace(",", ";").replace(".", ","), TRANSFER.replace(",", ";").replace(".", ",")),
        (ORDERS.replace(",0.5", ",50%"), TRANSFER.replace("0.2", "20%").replace("0.4", "40 %")),
        (
            ORDERS.replace(",0.5", ",50 %").replace(",", "|"),
            TRANSFER.replace(",", ";").replace("0.2", "20 %").replace(".", ","),
        ),
        (ORDERS.replace("\n", ",,\n"), TRANSFER.replace("\n", ",\n")),
        (ORDERS, TRANSFER.replace(",0.2,1\n", ",0.2,\n").replace(",1,0.4", ",-,0.4")),
        (
            ORDERS,
            TRANSFER.replace("\n", ",pot\n", 1).replace("1\n", "1,x\n").replace("4\n", "4,\n").replace("6\n", "6,2\n"),
        ),
        (ORDERS, TRANSFER + "pot,x,,7\n"),
        (ORDERS.replace("\n", ",a note\n"), TRANSFER),
        ("sep=;\n" + ORDERS.replace(",", ";"), TRANSFER),
    ],
)
def test_every_spelling_gives_the_same_problem(tmp_path, orders, transfer):
    plain, other = read_problem(*files(tmp_path)), read_problem(*files(tmp_path, orders, transfer))
    assert other.tasks == plain.tasks
    for name in ("c_rob", "c_hum", "c_fail", "c_demo", "pretrained", "transfer"):
        assert np.array_equal(getattr(other, name), getattr(plain, name)), name


@given(st.lists(st.floats(0, 1), min_size=6, max_size=6), st.sampled_from([".", ","]), st.booleans())
def test_any_table_is_read_to_the_bit(tmp_path_factory, values, mark, percent):
    texts = [f"{100 * value:.9f}%" if percent else repr(value) for value in values]
    cell = iter(texts)
    rows = [";".join([one, *("" if one == two else next(cell) for two in "abc")]) for one in "abc"]
    orders = "task,c_rob,c_hum,c_fail,c_demo\n" + "".join(f"{name},1,1,1,1\n" for name in "abc")
    transfer = "\n".join([";a;b;c", *rows]).replace(".", mark)
    problem = read_problem(*files(tmp_path_factory.getbasetemp(), orders, transfer))
    found = [problem.transfer[one, two] for one in range(3) for two in range(3) if one != two]
    assert found == [float(text.replace("%", "e-2")) for text in texts]


@given(
    st.lists(st.text("01.,%_-+eE \u00a0٠naif", max_size=5).map(str.strip), min_size=1, max_size=3),
    st.booleans(),
    st.sampled_from(["", ",", ".,"]),
)
def test_a_row_at_once_is_what_its_cells_are(texts, comma, unclear):
    sheet = Sheet("t.csv", ("", *map(str, range(len(texts)))), (), comma, unclear=unclear)
    places = [(2, name) for name in sheet.header[1:]]
    one_by_one, at_once = [], []
    try:
        one_by_one = [probability(sheet, 2, name, text) for name, text in zip(sheet.header[1:], texts, strict=True)]
        at_once = probabilities(sheet, places, texts).tolist()
    except InputError as problem:
        with pytest.raises(InputError, match=re.escape(str(problem))):
            probabilities(sheet, places, texts)
    assert at_once == one_by_one


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("c_fail", "c_oops", "orders.csv, row 1, column 'c_fail': column is missing; every task needs it"),
        ("c_fail", "c_fial", "orders.csv, row 1, column 'c_fial': unknown column; write 'c_fail' if that is meant"),
        ("pretrained", "Pretraned", "orders.csv, row 1, column 'Pretraned': unknown column; write 'pretrained' if"),
        ("c_hum", "C-Rob", "orders.csv, row 1, column 'C-Rob': means 'c_rob', and so does 'c_rob'; keep one"),
        (",c_demo", "", "orders.csv, row 2: has 6 cells; the header has 5"),
        ("c_demo,pretrained", "pretrained", "orders.csv, row 2: has 6 cells"),
        ("c_hum", "c_rob", "orders.csv, row 1, column 'c_rob': column appears twice"),
        ("task,", "name,", "orders.csv, row 1, column 'task': column is missing"),
        ("lid,10", "cup,10", "orders.csv, row 3, column 'task': task 'cup' appears twice"),
        ("lid,10", ",10", "orders.csv, row 3, column 'task': a task has no name"),
        ("lid,10", "lid,ten", "orders.csv, row 3, column 'c_rob': 'ten' is not a number"),
        (
            "lid,10",
            "lid,none",
            "orders.csv, row 3, column 'c_rob': 'none' is not a number; give a cost",
        ),
        ("lid,10", "lid,nan", "orders.csv, row 3, column 'c_rob': 'nan' is not allowed; give a cost of at least 0"),
        ("lid,10,100,100,200", "lid,inf,inf,100,", "orders.csv: task 'lid' cannot be done: nobody can do or teach it"),
        ("lid,10", "lid,1e300", "column 'c_rob': '1e300' is not allowed; give a cost of at least 0 and at most 1e100"),
        ("lid,10", "lid,1_0", "orders.csv, row 3, column 'c_rob': '1_0' is not a number"),
        ("lid,10", '"l\rd",10', "orders.csv, row 3, column 'task': task 'l\\rd' holds a control character; remove it"),
        ("lid,10", "l\0d,10", "orders.csv, row 3, column 'task': 'l\\x00d' holds a NUL character"),
        ("lid,10", "lid,-1", "orders.csv, row 3, column 'c_rob': '-1' is not allowed"),
        ("200,0.5", "200,1.5", "orders.csv, row 3, column 'pretrained': '1.5' is not allowed; give a probability"),
        ("200,0.5", "200,nan", "orders.csv, row 3, column 'pretrained': 'nan' is not allowed"),
    ],
)
def test_each_mistake_in_the_orders_gets_one_message_with_its_place(tmp_path, old, new, message):
    assert old in ORDERS
    with pytest.raises(InputError) as caught:
        read_problem(*files(tmp_path, orders=ORDERS.replace(old, new, 1)))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("transfer", "message"),
    [
        (TRANSFER.replace("0.2", "1.2"), "transfer.csv, row 2, column 'cup': '1.2' is not allowed; give a probability"),
        (TRANSFER.replace("0.2", "-0.2"), "transfer.csv, row 2, column 'cup': '-0.2' is not allowed"),
        (TRANSFER.replace("0.2", "nan"), "transfer.csv, row 2, column 'cup': 'nan' is not allowed"),
        (TRANSFER.replace("0.2", "inf"), "transfer.csv, row 2, column 'cup': 'inf' is not allowed"),
        (TRANSFER.replace("0.2", "maybe"), "transfer.csv, row 2, column 'cup': 'maybe' is not a number"),
        (TRANSFER.replace("0.2", ""), "transfer.csv, row 2, column 'cup': '' is not a number"),
        (
            TRANSFER.replace("0.2", "20"),
            "'20' is not allowed; give a probability in [0, 1], such as 0.95 or 95 %; if 20",
        ),
        (TRANSFER.replace("0.2", "120%"), "transfer.csv, row 2, column 'cup': '120%' is not allowed"),
        (TRANSFER.replace("0.2", "-"), "transfer.csv, row 2, column 'cup': '-' is not a number"),
        (TRANSFER.replace("0.2", "٠"), "transfer.csv, row 2, column 'cup': '٠' is not a number"),
        (TRANSFER.replace("0.2", '"0,2"'), "transfer.csv, row 2, column 'cup': '0,2' has a decimal comma, and numbers"),
        ("\n".join(TRANSFER.splitlines()[:3]), "transfer.csv: has no row for task 'box' of orders.csv"),
        (TRANSFER.replace("lid", "pot"), "transfer.csv, row 1: has no column for task 'lid' of orders.csv; add it"),
        (TRANSFER.replace("\nlid", "\npot"), "transfer.csv: has no row for task 'lid' of orders.csv; add it"),
        (TRANSFER.replace("lid", "Lid "), "transfer.csv, row 1: has no column for task 'lid' of orders.csv"),
        (TRANSFER.replace("\nlid", "\nlids"), "transfer.csv: has no row for task 'lid' of orders.csv; is it 'lids'?"),
        (",box,cup\ncup,0.3,1\nbox,1,0.5\n", "transfer.csv, row 1: has no column for task 'lid' of orders.csv"),
        (TRANSFER.replace("\nlid", "\ncup"), "transfer.csv, row 3: taught task 'cup' appears twice"),
        (TRANSFER.replace("box,cup", "cup,cup"), "transfer.csv, row 1, column 'cup': column appears twice"),
        (TRANSFER.replace("0.4", "0.4,0.4"), "transfer.csv, row 3: has 5 cells; the header has 4"),
        (TRANSFER.replace("0.2", "0.0_2"), "transfer.csv, row 2, column 'cup': '0.0_2' is not a number"),
        (TRANSFER.replace("\nlid", "\nl\0d"), "transfer.csv, row 2: 'l\\x00d' holds a NUL character"),
        (
            TRANSFER.replace(",", ":"),
            "transfer.csv, row 1: the header has one cell only; name the columns, and separate",
        ),
        ("", "transfer.csv: is empty"),
        (",box,cup,lid\n", "transfer.csv: has a header but no tasks"),
    ],
)
def test_each_mistake_in_the_table_gets_one_message_with_its_place(tmp_path, transfer, message):
    with pytest.raises(InputError) as caught:
        read_problem(*files(tmp_path, transfer=transfer))
    assert message in str(caught.value)


def test_a_column_that_is_missing_is_named(tmp_path):
    orders = "task,c_rob,c_hum,c_fail\ncup,10,100,100\n"
    with pytest.raises(InputError, match=r"orders.csv, row 1, column 'c_demo': column is missing"):
        read_problem(*files(tmp_path, orders=orders))


def test_files_that_cannot_be_read(tmp_path):
    orders, transfer = files(tmp_path, orders="")
    with pytest.raises(InputError, match=r"orders.csv: is empty"):
        read_problem(orders, transfer)
    with pytest.raises(InputError, match=r"absent.csv: no such file"):
        read_problem(tmp_path / "absent.csv", transfer)
    with pytest.raises(InputError, match="is a directory"):
        read_problem(tmp_path, transfer)
    orders.write_bytes(b"task,c_rob\n\xff\xfe\x00")
    with pytest.raises(InputError, match=r"row 2, column 'task': .* holds a NUL character"):
        read_problem(orders, transfer)
    orders.write_bytes(b"task,c_rob\n\x81,1")
    with pytest.raises(InputError, match="UTF-8 CSV"):
        read_problem(orders, transfer)
    with pytest.raises(InputError, match="standard input: can be read once; give a file for one of the tables"):
        read_problem("-", "-")
    with pytest.raises(ConfigError, match="order: 'best' is unknown"):
        read_problem(orders, transfer, "best")


def example():
    transfer = np.zeros((5, 5))
    transfer[1, 2:] = [0.9, 0.8, 0.05]
    return dataclasses.replace(thesis_set(5, transfer, c_demo=150.0), tasks=("a", "b", "c", "d", "e, red"))


def test_a_written_plan_holds_the_decisions_and_their_costs(tmp_path):
    problem = example()
    result = plan(problem)
    write_plan(tmp_path / "new", problem, result)
    with (tmp_path / "new" / "plan.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert list(rows[0]) == ["order", "task", "decision", "skill", "p_success", "expected_cost"]
    found = [(row["order"], row["task"], row["decision"], row["skill"]) for row in rows]
    assert found == [
        ("1", "a", "delegate", ""),
        ("2", "b", "learn", "b"),
        ("3", "c", "act", "b"),
        ("4", "d", "act", "b"),
        ("5", "e, red", "delegate", ""),
    ]
    assert sum(float(row["expected_cost"]) for row in rows) == pytest.approx(result.objective)
    summary = json.loads((tmp_path / "new" / "plan.json").read_text(encoding="utf-8"))
    counts = ["n_tasks", "n_act", "n_delegate", "n_learn"]
    assert list(summary) == ["planner", "order", "status", "objective", "lower_bound", "gap", "seconds", *counts]
    assert [summary[name] for name in counts] == [5, 2, 2, 1]
    assert (summary["planner"], summary["status"], summary["objective"]) == ("auto", "optimal", result.objective)


def test_json_never_holds_nan_or_infinity(tmp_path):
    problem = example()
    result = dataclasses.replace(plan(problem), lower_bound=-np.inf, gap=np.nan)
    write_plan(tmp_path, problem, result)
    summary = json.loads((tmp_path / "plan.json").read_text(encoding="utf-8"))
    assert summary["lower_bound"] is None
    assert summary["gap"] is None


def test_the_reasons_say_what_each_lesson_saves():
    problem = example()
    result = plan(problem)
    text = explain(problem, result)
    # lesson b (150) serves c at 20 and d at 30; the person would have done b, c and d for 300
    assert "proven optimal" in text
    assert "without any lesson 500.0" in text
    lesson = next(line for line in text.splitlines() if line.startswith("b "))
    assert lesson.split() == ["b", "150.0", "c,", "d", "300.0", "200.0", "100.0"]


@pytest.mark.parametrize("planner", ["auto", "cba", "alm"])
def test_the_reasons_are_given_for_every_kind_of_plan(planner):
    problem = thesis_set(12, np.full((12, 12), 0.9))
    text = explain(problem, plan(problem, planner))
    assert ("and 7 more" in text) == (planner != "alm")
    assert ("No lesson pays" in text) == (planner == "alm")


def test_numbers_are_written_without_the_noise_of_binary_fractions(tmp_path):
    problem = thesis_set(1, pretrained=0.95)
    result = plan(problem)
    assert result.expected_cost[0] != 15.0
    write_plan(tmp_path, problem, result)
    assert (tmp_path / "plan.csv").read_text(encoding="utf-8").splitlines()[1] == "1,part 0,act,,0.95,15"


def test_the_distance_from_the_optimum_is_relative_to_the_optimum():
    problem = example()
    result = dataclasses.replace(plan(problem), status="time_limit", objective=400.0, lower_bound=320.0, gap=0.2)
    assert "(time_limit, at most 25.00% above the optimum)" in explain(problem, result)
    unbounded = dataclasses.replace(result, lower_bound=0.0, gap=1.0)
    assert "(time_limit, the optimum is at least 0.0)" in explain(problem, unbounded)


def test_a_free_order_shows_in_the_file(tmp_path):
    transfer = np.zeros((4, 4))
    transfer[3] = 1.0
    problem = dataclasses.replace(thesis_set(4, transfer), order="any")
    result = plan(problem)
    write_plan(tmp_path, problem, result)
    tasks = [line.split(",")[1] for line in (tmp_path / "plan.csv").read_text(encoding="utf-8").splitlines()[1:]]
    assert tasks == ["part 3", "part 0", "part 1", "part 2"]
    assert result.count(Decision.LEARN) == 1


def test_an_empty_cost_or_inf_means_not_possible(tmp_path):
    orders = ORDERS.replace("lid,10,100", "lid,,inf")
    problem = read_problem(*files(tmp_path, orders))
    assert (problem.c_rob[1], problem.c_hum[1]) == (np.inf, np.inf)
    assert plan(problem).decision[1] == Decision.LEARN


@pytest.mark.parametrize("planner", ["auto", "greedy", "ad"])
def test_a_plan_that_is_read_again_is_the_plan(tmp_path, planner):
    problem = dataclasses.replace(random_transfer(60), tasks=("=1+1", "'=1+1", "-x", "@y", *map(str, range(56))))
    day = plan(problem, planner)
    write_plan(tmp_path, problem, day)
    again = read_plan(tmp_path, problem)
    assert check_certificate(problem, again).cost == day.objective
    for name in ("decision", "skill", "sequence", "status", "lower_bound", "gap", "planner"):
        assert np.array_equal(getattr(again, name), getattr(day, name)), name
    text = (tmp_path / "plan.csv").read_text()
    assert not [cell for row in csv.reader(text.splitlines()) for cell in row if cell[:1] in ("=", "-", "@", "+")]


@pytest.mark.parametrize(
    ("file", "change", "error", "message"),
    [
        ("plan.csv", lambda text: text[: len(text) // 2], InputError, "row|name each"),
        ("plan.csv", lambda text: text.replace(",learn,", ",dance,", 1), InputError, "is no row of a plan"),
        ("plan.csv", lambda _: "", InputError, "row 1: is not order,task"),
        ("plan.csv", lambda text: text.splitlines()[0], InputError, "does not name each of the 60 tasks once"),
        (
            "plan.json",
            lambda text: text.replace('"n_learn": ', '"n_learn": 9'),
            ArtifactError,
            "n_learn is 9.*, but plan",
        ),
        (
            "plan.json",
            lambda text: text.replace('"objective": ', '"objective": 1' + 400 * "0"),
            SolverError,
            "objective",
        ),
        ("plan.json", lambda _: 100_000 * "[", ArtifactError, "cannot be read as a plan's summary"),
        ("plan.csv", lambda text: text.replace("\n1,", "\n2,", 1), InputError, "its order is '2'"),
        ("plan.csv", lambda text: text.replace("order,", "decision,", 1), InputError, "row 1: is not order,task"),
        ("plan.json", lambda text: text[:-9], ArtifactError, "cannot be read as a plan's summary"),
        ("plan.json", lambda _: "[]", ArtifactError, "is no summary of a plan"),
        ("plan.json", lambda text: text.replace('"optimal"', '"heuristic"'), SolverError, "status is 'heuristic'"),
        ("plan.json", lambda text: text.replace('"lower_bound": ', '"lower_bound": 9'), SolverError, "lower_bound is"),
        ("plan.csv", lambda text: text.replace(",act,", ",delegate,", 1), ArtifactError, "n_act is"),
    ],
)
def test_a_plan_that_was_tampered_with_is_refused(tmp_path, file, change, error, message):
    problem = random_transfer(60)
    write_plan(tmp_path, problem, plan(problem))
    (tmp_path / file).write_text(change((tmp_path / file).read_text()))
    with pytest.raises(error, match=message):
        check_certificate(problem, read_plan(tmp_path, problem))


def test_half_a_certificate_is_refused_and_none_is_said_to_be_missing(tmp_path):
    problem = random_transfer(60)
    write_plan(tmp_path, problem, plan(problem))
    whole = (tmp_path / "certificate.npz").read_bytes()
    (tmp_path / "certificate.npz").write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ArtifactError, match=r"certificate\.npz: (damaged|not a p2l array)"):
        read_plan(tmp_path, problem)
    (tmp_path / "certificate.npz").unlink()
    with pytest.raises(SolverError, match="none given"):
        check_certificate(problem, read_plan(tmp_path, problem))


def test_a_plan_of_other_tasks_is_refused(tmp_path):
    problem, other = thesis_set(4), thesis_set(5)
    with pytest.raises(ShapeError, match="plan: is of 4 tasks; the problem has 5"):
        explain(other, plan(problem))
    with pytest.raises(ShapeError, match="plan: is of 4 tasks; the problem has 5"):
        write_plan(tmp_path, other, plan(problem))
    (tmp_path / "file").write_text("")
    with pytest.raises(ArtifactError, match="is a file; give a folder"):
        write_plan(tmp_path / "file", problem, plan(problem))


@pytest.mark.parametrize("given", [None, "plan", 3])
def test_what_is_no_plan_is_named(given):
    for function in (explain, check_certificate):
        with pytest.raises((ShapeError, SolverError), match="expected"):
            function(thesis_set(3), given)


def test_names_reach_the_terminal_written_out():
    spoof = dataclasses.replace(thesis_set(3, np.ones((3, 3))), tasks=("a\nExpected cost 1.0", "b", "c"))
    assert not [line for line in explain(spoof, plan(spoof)).splitlines() if line.startswith("Expected cost 1.0")]
    problem = dataclasses.replace(thesis_set(3, np.ones((3, 3))), tasks=("a\x1b[31m", "b", "c"))
    assert "a\\x1b[31m" in explain(problem, plan(problem))
    assert "\x1b" not in explain(problem, plan(problem))
