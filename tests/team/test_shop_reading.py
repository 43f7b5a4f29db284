import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from p2l.errors import ConfigError, InputError, ShapeError
from p2l.team.files import read_problem
from p2l.team.shop import Ruling, Shop, plan_shop, read_shop

ORDERS = "task,c_rob,c_hum,c_fail,c_demo,pretrained\ncup,10,100,100,200,0\nlid,10,100,100,200,0.5\nbox,1e1,90,80,70,1\n"
SQUARE = ",box,cup,lid\nlid,0.1,0.2,1\ncup,0.3,1,0.4\nbox,1,0.5,0.6\n"
LONG = "taught,tested,p\nlid,box,0.1\nlid,cup,0.2\ncup,box,0.3\ncup,lid,0.4\nbox,cup,0.5\nbox,lid,0.6\n"
TABLE = [[1, 0.4, 0.3], [0.2, 1, 0.1], [0.5, 0.6, 1]]
ARRAYS = ("completes", "count", "c_hum", "c_rob", "c_fail", "pretrained", "c_demo", "transfer", "choice", "before")
inf = math.inf


def read(tmp_path, orders=ORDERS, transfer=SQUARE, *, before=None, robots=None, **settings_):
    tables = {"orders": orders, "transfer": transfer, "before": before, "robots": robots}
    paths = {name: tmp_path / f"{name}.csv" for name, text in tables.items() if text is not None}
    for name, path in paths.items():
        path.write_text(tables[name], encoding="utf-8")
    others = {name: paths[name] for name in ("before", "robots") if name in paths}
    return read_shop(paths["orders"], paths.get("transfer"), **others, **{"order": "any", **settings_})


def same(one, two):
    for name in ("tasks", "robots", "lessons", "order", "max_lessons", "max_teaching"):
        assert getattr(one, name) == getattr(two, name), name
    for name in ARRAYS:
        assert np.array_equal(getattr(one, name), getattr(two, name)), name


def with_column(name, *cells, table=ORDERS):
    """A table with one more column at its end."""
    rows = table.splitlines()
    return "\n".join(f"{row},{cell}" for row, cell in zip(rows, [name, *cells], strict=True)) + "\n"


def test_a_square_table_is_the_thesis_problem(tmp_path):
    day = read(tmp_path)
    assert (day.shop.tasks, day.shop.lessons, day.shop.robots) == (
        ("cup", "lid", "box"),
        ("cup", "lid", "box"),
        ("robot",),
    )
    assert day.shop.transfer[0].tolist() == TABLE
    assert (day.remarks, day.family, dict(day.extra)) == ((), None, {})
    same(day.shop, Shop.of_problem(read_problem(tmp_path / "orders.csv", tmp_path / "transfer.csv", "any")))


@pytest.mark.parametrize(
    "transfer",
    [
        LONG,
        LONG.replace(",p\n", ",Probability\n"),
        LONG.replace(",p\n", ",mean\n").replace(",", ";").replace(".", ","),
        LONG.replace("\n", ",\n").replace(",p,", ",p,n"),
        with_column("low", *range(6), table=LONG),
        LONG + "pot,cup,0.9\ncup,pot,maybe\n",
        LONG.replace("0.2", "20 %").replace("p\n", "p\ncup,cup,1\nbox,box,-\n"),
        (
            "taught,tested,successes,attempts\nlid,box,1,10\nlid,cup,1,5\ncup,box,3,10\ncup,lid,2,5\nbox,cup,1,2\n"
            "box,lid,6,10\nbox,box,0,0\n"
        ),
        SQUARE.replace(",box", ",pot,box")
        .replace("\nlid,", "\nlid,x,")
        .replace("\ncup,", "\ncup,7,")
        .replace("\nbox,", "\nbox,,"),
        SQUARE.replace("1\n", "NA\n", 1).replace(",1,", ",-,"),
        SQUARE + "pot,x,,7\n",
    ],
)
def test_every_form_of_a_whole_table_says_the_same(tmp_path, transfer):
    plain, other = read(tmp_path).shop, read(tmp_path, transfer=transfer).shop
    assert np.array_equal(plain.transfer, other.transfer)
    assert plain.lessons == other.lessons


@st.composite
def days(draw):
    n = draw(st.integers(1, 5))
    cost = st.one_of(st.floats(0, 1e6), st.just(inf))
    costs = [[draw(cost), draw(st.floats(0, 1e6)), *(draw(cost) for _ in range(2))] for _ in range(n)]
    table = [[draw(st.floats(0, 1)) for _ in range(n)] for _ in range(n)]
    shuffle = [draw(st.permutations(range(n))) for _ in range(2)]
    return costs, table, shuffle, draw(st.sampled_from(["fixed", "any"])), draw(st.integers(0, 99))


@given(days())
@settings(max_examples=40)
def test_all_forms_are_read_to_the_bit(tmp_path_factory, day):
    costs, table, (rows, columns), order, seed = day
    names = [f"part {each}" for each in range(len(costs))]
    orders = "task,c_rob,c_hum,c_fail,c_demo\n" + "".join(
        f"{name},{','.join(map(repr, row))}\n" for name, row in zip(names, costs, strict=True)
    )
    square = ",".join(["", *(names[j] for j in columns)]) + "\n"
    square += "".join(",".join([names[i], *(repr(table[i][j]) for j in columns)]) + "\n" for i in rows)
    pairs = [f"{names[i]},{names[j]},{table[i][j]!r}\n" for i in rows for j in columns]
    np.random.default_rng(seed).shuffle(pairs)
    tmp_path = tmp_path_factory.getbasetemp()
    one = read(tmp_path, orders, square, order=order)
    problem = read_problem(tmp_path / "orders.csv", tmp_path / "transfer.csv", order)
    same(one.shop, Shop.of_problem(problem))
    header, *body = square.splitlines()
    rectangular = "\n".join([f"{header},spare", *(f"{row},x" for row in body), f"spare{',x' * (len(body) + 1)}"])
    same(read(tmp_path, orders, rectangular, order=order).shop, one.shop)
    same(read(tmp_path, orders, "taught,tested,p\n" + "".join(pairs), order=order).shop, one.shop)
    assert one.remarks == ()


@given(st.lists(st.tuples(st.floats(0, 1), st.integers(0, 50)), min_size=1, max_size=6))
@settings(max_examples=40)
def test_repeated_measurements_are_weighed_by_n(tmp_path_factory, values):
    weights = [weight for _, weight in values]
    transfer = "taught,tested,p,n\n" + "".join(f"lid,cup,{p!r},{n}\n" for p, n in values)
    day = read(tmp_path_factory.getbasetemp(), transfer=transfer, fill=0.25)
    mean = np.average([p for p, _ in values], weights=weights) if any(weights) else 0.25
    assert day.shop.transfer[0, 1, 0] == pytest.approx(mean)
    assert re.fullmatch(rf"{6 - any(weights)} of 6 pairs .*\(fill=0.25\)", day.remarks[-1])
    assert ("weighted by n" in day.remarks[0]) == (np.count_nonzero(weights) > 1)


def test_counts_are_pooled_as_counts(tmp_path):
    transfer = "taught,tested,successes,attempts,p_old\nlid,cup,1,1,x\nlid,cup,0,3,x\nlid,box,,0,x\n"
    day = read(tmp_path, transfer=transfer, fill=0)
    assert day.shop.transfer[0].tolist() == [[1, 0, 0], [0.25, 1, 0], [0, 0, 1]]
    assert day.remarks == (
        "1 of the pairs are in transfer.csv more than once; their mean is taken, all successes by all attempts",
        "5 of 6 pairs have no value in transfer.csv; taken as 0 (fill=0)",
    )


def test_what_the_predictor_writes_is_read(tmp_path):
    transfer = "taught,tested,p,low,high,trials,successes,supported_by\n" + "".join(
        f"{one},{two},0.250000,0.1,0.6,4,1,{one}>{two}:1/4\n"
        for one in ("cup", "lid", "box")
        for two in ("cup", "lid", "box")
    )
    day = read(tmp_path, transfer=transfer)
    assert (day.shop.transfer == 0.25).all()
    assert day.remarks == ()


def test_names_that_a_spreadsheet_would_run_are_known_with_their_apostrophe(tmp_path):
    transfer = LONG.replace("lid", "'=lid")
    assert read(tmp_path, ORDERS.replace("lid", "=lid"), transfer).shop.transfer[0].tolist() == TABLE


COLUMNS = [
    (with_column("count", 1, "", "3.0"), {"count": [1, 1, 3]}),
    (with_column("Decision", "Act", "!Learn", ""), {"choice": [Ruling.ACT, Ruling.NOT_LEARN, Ruling.FREE]}),
    (with_column("decision", "DELEGATE", "learn", "! learn"), {"choice": [Ruling.DELEGATE, Ruling.LEARN, 3]}),
    (ORDERS.replace("200,0.5", "200,"), {"pretrained": [[0, 0, 1]]}),
    (with_column("teachable", "", "no", "ja"), {"c_demo": [[200, inf, 70]]}),
    (with_column("demo success", "", 0.5, "20%"), {"c_demo": [[200, 400, 350]], "transfer": [TABLE]}),
    (
        with_column("demo_tries", "", 2, 3, table=with_column("demo_success", 0.5, 0.5, 1)),
        {"c_demo": [[400, 400, 210]], "transfer": [[[1, 0.4, 0.3], [0.15, 1, 0.075], [0.5, 0.6, 1]]]},
    ),
    (ORDERS.replace("10,100,100,200,0\n", "10,100,100,never,0\n"), {"c_demo": [[inf, 200, 70]]}),
]


@pytest.mark.parametrize(("orders", "expected"), COLUMNS)
def test_each_column_of_the_orders_says_what_it_should(tmp_path, orders, expected):
    transfer = SQUARE.replace(",1\n", ",\n").replace("box,1", "box,0.9").replace(",1,", ",,")
    shop = read(tmp_path, orders, transfer).shop
    for name, value in expected.items():
        found = getattr(shop, name).copy()
        if name == "transfer":
            found[:, [0, 1, 2], [0, 1, 2]] = 1
        assert found == pytest.approx(np.array(value)), name


def test_a_demonstration_that_may_not_teach_is_told_of(tmp_path):
    orders = with_column("demo_tries", "", 2, "", table=with_column("demo_success", 0.5, 0.5, ""))
    assert read(tmp_path, orders).remarks == (
        "a demonstration is repeated until it has taught, at c_demo / demo_success ('cup')",
        "demonstrations are given demo_tries times, and nobody looks whether they have taught ('lid')",
    )


def test_other_columns_are_passed_through(tmp_path):
    orders = with_column("Note", "red", "", "a;b", table=with_column("family", "pot", "", "pot"))
    day = read(tmp_path, orders)
    assert day.family == ("pot", "", "pot")
    assert day.extra == {"Note": ("red", "", "a;b")}


GAPS = [
    (SQUARE.replace("0.2", ""), "1 of 6 pairs has", [(1, 0)]),
    (SQUARE.replace("0.2", "-").replace("0.3", "n/a"), "2 of 6 pairs have", [(0, 2), (1, 0)]),
    (SQUARE.replace("cup,0.3,1,0.4\n", ""), "2 of 6 pairs have", [(0, 1), (0, 2)]),
    (",box,cup\nlid,0.1,0.2\ncup,0.3,1\nbox,1,0.5\n", "2 of 6 pairs have", [(0, 1), (2, 1)]),
    (LONG.replace("lid,cup,0.2\n", ""), "1 of 6 pairs has", [(1, 0)]),
    (LONG.replace("lid,cup,0.2", "lid,cup,NA"), "1 of 6 pairs has", [(1, 0)]),
    ("taught,tested,p\n", "6 of 6 pairs have", [(i, j) for i in range(3) for j in range(3) if i != j]),
]


@pytest.mark.parametrize(("transfer", "many", "gaps"), GAPS)
def test_gaps_are_filled_and_told_of(tmp_path, transfer, many, gaps):
    expected = np.array(TABLE)
    for gap in gaps:
        expected[gap] = 0.125
    day = read(tmp_path, transfer=transfer, fill=0.125)
    assert day.shop.transfer[0].tolist() == expected.tolist()
    assert day.remarks == (f"{many} no value in transfer.csv; taken as 0.125 (fill=0.125)",)
    asked = []

    def filling(taught, tested):
        asked.append((taught, tested))
        return np.full((len(taught), len(tested)), 0.125)

    day = read(tmp_path, transfer=transfer, filling=filling)
    assert day.shop.transfer[0].tolist() == expected.tolist()
    assert day.remarks == (f"{many} no value in transfer.csv; predicted",)
    names = ("cup", "lid", "box")
    rows, columns = ({gap[axis] for gap in gaps} for axis in (0, 1))
    assert asked == [(tuple(names[i] for i in sorted(rows)), tuple(names[j] for j in sorted(columns)))]
    message = f"transfer.csv: has no value for {many.rsplit(' ', 1)[0]}, .*'{names[gaps[0][0]]}' taught and"
    with pytest.raises(InputError, match=f"{message}.*fill=0.*features="):
        read(tmp_path, transfer=transfer)


def test_pairs_that_no_plan_uses_need_no_value(tmp_path):
    above = "taught,tested,p\ncup,lid,0.4\ncup,box,0.3\nlid,box,0.1\n"
    day = read(tmp_path, transfer=above, order="fixed")
    assert day.remarks == ()
    assert np.triu(day.shop.transfer[0], 1).tolist() == np.triu(TABLE, 1).tolist()
    orders = with_column("decision", "delegate", "!learn", "")
    assert read(tmp_path, orders, "taught,tested,p\nbox,lid,0.6\n").remarks == ()
    before = "before,after\ncup,lid\nlid,box\n"
    assert len(read(tmp_path, transfer=above, before=before).remarks) == 0


def test_copies_need_what_a_lesson_does_on_its_own_task(tmp_path):
    orders = with_column("count", 2, 1, 1)
    given_ = LONG + "cup,cup,0.7\n"
    assert read(tmp_path, orders, given_).shop.transfer[0, 0, 0] == 0.7
    with pytest.raises(InputError, match="has no value for 1 of 7 pairs, that of 'cup' taught and 'cup' tested"):
        read(tmp_path, orders, LONG)
    day = read(tmp_path, orders, LONG, fill=0.5)
    assert day.shop.transfer[0].tolist() == [[0.5, 0.4, 0.3], [0.2, 1, 0.1], [0.5, 0.6, 1]]
    assert day.remarks == (
        "1 of 7 pairs has no value in transfer.csv; taken as 0.5 (fill=0.5)",
        "among them how probably a lesson does the other copies of its own task ('cup')",
    )


def test_no_table_at_all_is_filled_as_well(tmp_path):
    day = read(tmp_path, transfer=None, filling=lambda taught, tested: np.full((len(taught), len(tested)), 0.3))
    assert day.shop.transfer[0, 0, 1] == 0.3
    assert day.remarks == ("6 of 6 pairs have no value in the transfer table; predicted",)


@pytest.mark.parametrize("wrong", [np.zeros((1, 1)), np.full((3, 3), np.nan), np.full((3, 3), 1.5)])
def test_a_filling_is_checked(tmp_path, wrong):
    with pytest.raises(ShapeError, match="filling"):
        read(tmp_path, transfer=None, filling=lambda taught, tested: wrong)


def test_lessons_of_a_catalogue_come_first_if_their_cost_is_known(tmp_path):
    transfer = "task,cup,lid,box,C Demo,pan\ncap,0.9,0.8,0.7,30,x\ncup,,0.4,0.3,200,\npot,x,x,x,,x\n"
    transfer += "rag,x,x,x,never,x\nlid,.2,,.1,,\nbox,.5,.6,,,\n"
    day = read(tmp_path, transfer=transfer)
    assert day.shop.lessons == ("cup", "lid", "box", "cap")
    assert day.shop.completes.tolist() == [0, 1, 2, -1]
    assert day.shop.c_demo.tolist() == [[200, 200, 70, 30]]
    assert day.shop.transfer[0].tolist() == [*TABLE, [0.9, 0.8, 0.7]]
    assert day.remarks == (
        "1 lesson is in transfer.csv and not among the tasks; taught first ('cap')",
        "1 lesson is in transfer.csv and not among the tasks, without c_demo; left out ('pot')",
    )
    # cap (30) makes cup 10 + 0.1 * 100 and lid 10 + 0.2 * 100; box is surely done at 10
    assert plan_shop(day.shop).objective == pytest.approx(30 + 20 + 30 + 10)


def test_lessons_of_a_catalogue_in_a_table_of_pairs(tmp_path):
    rows = ["cap,cup,0.9,30", "cap,lid,0.8,", "cap,box,0.7,30", "pot,cup,1,"]
    day = read(tmp_path, transfer=with_column("c_demo", *[""] * 6, table=LONG) + "\n".join(rows) + "\n")
    assert day.shop.lessons == ("cup", "lid", "box", "cap")
    assert day.shop.c_demo.tolist() == [[200, 200, 70, 30]]
    assert day.shop.transfer[0].tolist() == [*TABLE, [0.9, 0.8, 0.7]]


ROBOTS = """robot,task,c_rob,c_fail,c_demo,pretrained,teachable,skill,note
small,,5,,20,,,0.5,slow
large,,,,,,no,,
small,lid,7,never,,0.25,,1,
small,box,,,,,no,,
"""


def test_robots_replace_what_the_orders_say(tmp_path):
    day = read(tmp_path, robots=ROBOTS)
    shop = day.shop
    assert shop.robots == ("small", "large")
    assert shop.c_rob.tolist() == [[5, 7, 5], [10, 10, 10]]
    assert shop.c_fail.tolist() == [[100, inf, 80], [100, 100, 80]]
    assert shop.pretrained.tolist() == [[0, 0.25, 1], [0, 0.5, 1]]
    assert shop.c_demo.tolist() == [[20, 20, inf], [inf, inf, inf]]
    assert shop.transfer[1].tolist() == TABLE
    assert shop.transfer[0].tolist() == (np.array(TABLE) * [0.5, 1, 0.5]).tolist()
    assert shop.c_hum.tolist() == [100, 100, 90]
    assert day.remarks == (f"not read in {tmp_path / 'robots.csv'}: 'note'",)


def test_a_robot_in_general_does_not_make_possible_what_the_orders_rule_out(tmp_path):
    """A row of the robot and the task does."""
    orders = (
        "task,c_rob,c_hum,c_fail,c_demo,teachable\ncup,never,100,100,-,\nlid,10,100,never,200,no\nbox,10,90,80,70,\n"
    )
    robots = "robot,task,c_rob,c_fail,c_demo,teachable\narm,,5,50,20,yes\nhand,,5,50,20,yes\n"
    transfer = with_column("c_demo", "", "", "", table=SQUARE) + "cap,0.9,0.8,0.7,never\n"
    own = "hand,cup,6,,30,\nhand,lid,,60,,yes\n"
    shop = read(tmp_path, orders, transfer, robots=robots + own).shop
    assert shop.c_rob.tolist() == [[inf, 5, 5], [6, 5, 5]]
    assert shop.c_fail.tolist() == [[50, inf, 50], [50, 60, 50]]
    assert shop.lessons == ("cup", "lid", "box")
    assert shop.c_demo.tolist() == [[inf, inf, 20], [30, 20, 20]]


def test_a_lesson_of_the_catalogue_may_cost_each_robot_something_else(tmp_path):
    transfer = with_column("c_demo", "", "", "", table=SQUARE) + "cap,0.9,0.8,0.7,\npot,x,x,x,\n"
    day = read(tmp_path, transfer=transfer, robots="robot,task,c_demo\na,cap,30\nb,,50\n")
    assert day.shop.lessons == ("cup", "lid", "box", "cap")
    assert day.shop.c_demo.tolist() == [[200, 200, 70, 30], [50, 50, 50, inf]]


def test_a_table_of_pairs_may_be_of_one_robot(tmp_path):
    rows = [row + "," for row in LONG.splitlines()[1:]] + ["cup,lid,0.8,small", "cup,lid,0.6,small"]
    transfer = "\n".join(["taught,tested,p,robot", *rows]) + "\n"
    day = read(tmp_path, transfer=transfer, robots="robot,skill\nsmall,0.5\nlarge,\n")
    assert day.shop.transfer[1].tolist() == TABLE
    assert day.shop.transfer[0] == pytest.approx(np.array([[0.5, 0.7, 0.15], [0.1, 0.5, 0.05], [0.25, 0.3, 0.5]]))
    assert [remark.split(" ", 2)[0] for remark in day.remarks] == ["skill", "1"]
    only_small = "\n".join(["taught,tested,p,robot", *(row + "small" for row in rows[:6])]) + "\n"
    with pytest.raises(InputError, match="no value for 6 of 6 pairs"):
        read(tmp_path, transfer=only_small, robots="robot,skill\nsmall,0.5\nlarge,\n")


def test_a_partial_order(tmp_path):
    day = read(
        tmp_path, before="Before,After,why\nbox,cup\nbox,cup\nlid,cup\n".replace("cup\n", "cup,x\n"), order="fixed"
    )
    assert day.shop.order == "partial"
    assert day.shop.arcs.tolist() == [[2, 0], [1, 0]]
    assert read(tmp_path, order="partial").shop.arcs.tolist() == []
    assert read(tmp_path, before="before,after\n").shop.order == "partial"


def test_limits_are_passed_on(tmp_path):
    shop = read(tmp_path, max_lessons=2, max_teaching=90.5).shop
    assert (shop.max_lessons, shop.max_teaching) == (2, 90.5)


WRONG = [
    ({"orders": ORDERS.replace("task", "name")}, "orders.csv, row 1, column 'task': column is missing"),
    (
        {"orders": with_column("decison", "", "", "")},
        "orders.csv, row 1, column 'decison': unknown column; write 'deci",
    ),
    ({"orders": with_column("Demo succes", 1, 1, 1)}, "orders.csv, row 1, column 'Demo succes': unknown column; write"),
    ({"orders": with_column("decision", "", "dance", "")}, "orders.csv, row 3, column 'decision': 'dance' is no deci"),
    (
        {"orders": with_column("Count", "", 0, "")},
        "orders.csv, row 3, column 'Count': '0' is not allowed; give a whole",
    ),
    ({"orders": with_column("count", "", 1.5, "")}, "orders.csv, row 3, column 'count': '1.5' is not allowed; give a"),
    ({"orders": with_column("count", "", "-1", "")}, "orders.csv, row 3, column 'count': '-1' is not allowed; give a"),
    (
        {"orders": with_column("teachable", "", "so so", "")},
        "orders.csv, row 3, column 'teachable': 'so so' is neither",
    ),
    ({"orders": with_column("demo_success", 1, 1, 0)}, "orders.csv, row 4, column 'demo_success': '0' is not allowed"),
    ({"orders": with_column("demo_success", 1, 1, 2)}, "orders.csv, row 4, column 'demo_success': '2' is not allowed"),
    ({"orders": with_column("demo_success", 1, 1, "1e-300")}, "orders.csv, row 4, column 'demo_success': so many"),
    (
        {"orders": with_column("demo_tries", "", 2, "")},
        "orders.csv, row 3, column 'demo_tries': task 'lid' needs a demo",
    ),
    (
        {"orders": with_column("demo_success", 1, "", 1, table=with_column("demo_tries", "", 2, ""))},
        "orders.csv, row 3, column 'demo_tries': task 'lid' needs a demo_success",
    ),
    (
        {"transfer": SQUARE.replace("0.2", "1.2")},
        "transfer.csv, row 2, column 'cup': '1.2' is not allowed; give a prob",
    ),
    ({"transfer": SQUARE.replace("0.2", "nan")}, "transfer.csv, row 2, column 'cup': 'nan' is not allowed"),
    ({"transfer": SQUARE.replace("\nlid", "\ncup")}, "transfer.csv, row 3: taught task 'cup' appears twice"),
    (
        {"transfer": SQUARE.replace("\nlid", "\nLid")},
        "transfer.csv, row 2: 'Lid' is 'lid' in the orders; write it alike",
    ),
    (
        {"transfer": SQUARE.replace(",lid", ",L id").replace("L id", "LID")},
        "row 1, column 'LID': 'LID' is 'lid' in the",
    ),
    ({"transfer": SQUARE.replace("\nlid", "\nlids"), "fill": None}, "'lids' is no task of the orders; is it 'lid'?"),
    ({"transfer": "a,b\nc,1\n"}, "transfer.csv, row 1: no column is for a task of orders.csv; give one for each, or"),
    ({"transfer": LONG.replace("tested", "tetsed")}, "transfer.csv, row 1: no column is for a task"),
    (
        {"transfer": LONG.replace(",p\n", ",prob\n")},
        "transfer.csv, row 1, column 'p': column is missing; every pair ne",
    ),
    ({"transfer": LONG.replace(",p\n", ",successes\n")}, "transfer.csv, row 1, column 'attempts': column is missing"),
    (
        {"transfer": with_column("mean", *range(6), table=LONG)},
        "row 1, column 'p': means 'p', and so does 'mean'; keep",
    ),
    ({"transfer": LONG.replace("0.2", "20")}, "transfer.csv, row 3, column 'p': '20' is not allowed; give a probabil"),
    (
        {"transfer": with_column("n", 1, -1, 1, 1, 1, 1, table=LONG)},
        "transfer.csv, row 3, column 'n': '-1' is not allowed",
    ),
    ({"transfer": LONG.replace("lid,cup", ",cup")}, "transfer.csv, row 3, column 'taught': a lesson has no name"),
    ({"transfer": LONG.replace("lid,cup", "lid,")}, "transfer.csv, row 3, column 'tested': a tested task has no name"),
    (
        {"transfer": LONG.replace("lid,cup", "Lid,cup").replace("lid,box", "Lid,box")},
        "row 2, column 'taught': 'Lid' is",
    ),
    ({"transfer": "taught,tested,p\na,b,0.5\n"}, "transfer.csv, column 'tested': no row is for a task of the orders"),
    ({"transfer": with_column("robot", *"aaaaaa", table=LONG)}, "transfer.csv, row 2, column 'robot': 'a' is no robot"),
    (
        {"transfer": "taught,tested,successes,attempts\nlid,cup,3,2\n"},
        "transfer.csv, row 2, column 'successes': 3 successes of 2 attempts; give at most as many",
    ),
    (
        {"transfer": "taught,tested,successes,attempts\nlid,cup,,2\n"},
        "transfer.csv, row 2, column 'successes': '' is not a number",
    ),
    (
        {"transfer": with_column("c_demo", 150, "", "", table=SQUARE)},
        "transfer.csv, row 2, column 'c_demo': 150 for 'lid', which costs 200 in the orders; keep one",
    ),
    (
        {"transfer": with_column("c_demo", *[""] * 6, table=LONG) + "cap,cup,1,30\ncap,lid,1,31\n"},
        "transfer.csv, row 9, column 'c_demo': 31 for 'cap', which costs '30' in an earlier row; keep one",
    ),
    ({"transfer": with_column("c_demoo", 1, 1, 1, table=SQUARE)}, "transfer.csv, row 1, column 'c_demoo': unknown col"),
    ({"robots": "robt,skill\na,1\n"}, "robots.csv, row 1, column 'robt': unknown column; write 'robot'"),
    ({"robots": "robot,skil\na,1\n"}, "robots.csv, row 1, column 'skil': unknown column; write 'skill'"),
    ({"robots": "robot,skill\n"}, "robots.csv: has a header but no robots"),
    ({"robots": "robot,skill\n,1\n"}, "robots.csv, row 2, column 'robot': a robot has no name"),
    (
        {"robots": "robot,skill\na,1\nb,1\na,1\n"},
        "robots.csv, row 4, column 'robot': robot 'a' without a task is in row 2",
    ),
    (
        {"robots": "robot,task\na,cup\na,cup\n"},
        "robots.csv, row 3, column 'robot': robot 'a' with task 'cup' is in row 2",
    ),
    (
        {"robots": "robot,task\na,cupp\n"},
        "robots.csv, row 2, column 'task': 'cupp' is no task of the orders; is it 'cup'?",
    ),
    ({"robots": "robot,skill\na,1.5\n"}, "robots.csv, row 2, column 'skill': '1.5' is not allowed"),
    ({"robots": "robot,c_rob\na,-5\n"}, "robots.csv, row 2, column 'c_rob': '-5' is not allowed"),
    (
        {"robots": "robot,task,skill\na,cap,1\n", "transfer": SQUARE + "cap,1,1,1\n"},
        "robots.csv, row 2, column 'skill': 'cap' is a lesson and no task of the orders; only c_demo and teachable",
    ),
    ({"before": "befor,after\ncup,lid\n"}, "before.csv, row 1, column 'befor': unknown column; write 'before'"),
    ({"before": "before,x\ncup,lid\n"}, "before.csv, row 1, column 'after': column is missing"),
    ({"before": "before,after\ncup,lod\n"}, "before.csv, row 2, column 'after': 'lod' is no task of the orders; take"),
    (
        {"before": "before,after\ncup,lids\n"},
        "before.csv, row 2, column 'after': 'lids' is no task of the orders; is it",
    ),
    ({"before": "before,after\ncup,\n"}, "before.csv, row 2, column 'after': a task has no name"),
    ({"before": "before,after\ncup,cup\n"}, "before.csv, row 2: task 'cup' is before itself"),
    (
        {"before": "before,after\ncup,lid\nlid,box\nbox,lid\n"},
        "before.csv, row 3: rows 3, 4 go in a circle: 'lid' before 'box' before 'lid'; take one of them out",
    ),
    (
        {"before": "before,after\ncup,lid\nlid,box\nbox,cup\n"},
        "before.csv, row 2: rows 2, 3, 4 go in a circle: ",
    ),
]


@pytest.mark.parametrize(("tables", "message"), WRONG)
def test_each_mistake_gets_one_message_with_its_place(tmp_path, tables, message):
    with pytest.raises(InputError) as caught:
        read(tmp_path, **tables)
    text = str(caught.value)
    assert message in text
    assert "\n" not in text


def impossible(cell, decision="", count=1):
    """Orders whose second task has these cells for c_rob, c_hum, c_fail, c_demo."""
    orders = ORDERS.replace("lid,10,100,100,200,0.5", f"lid,{cell},0.5")
    return with_column("count", 1, count, 1, table=with_column("decision", "", decision, "", table=orders))


IMPOSSIBLE = [
    (impossible("inf,inf,100,"), {}, "row 3: task 'lid' cannot be done: nobody can do or teach it, and no lesson"),
    (impossible("10,inf,inf,inf"), {}, "row 3: task 'lid' cannot be done: nobody can do or teach it, and no lesson"),
    (impossible("10,inf,100,200", "delegate"), {}, "row 3, column 'decision': task 'lid' is to be delegated, and the"),
    (impossible("10,100,100,inf", "learn"), {}, "row 3, column 'decision': task 'lid' is to be taught, and cannot be"),
    (impossible("inf,100,100,200", "act"), {}, "row 3, column 'decision': task 'lid' is to be attempted, and no atte"),
    (impossible("inf,inf,100,200", "!learn"), {}, "row 3: task 'lid' cannot be done"),
    (impossible("inf,inf,100,200", "", 2), {}, "row 3: task 'lid', after its first copy, cannot be done"),
    (impossible("inf,inf,1,9"), {"robots": "robot,teachable\na,no\nb,no\n"}, "row 3: task 'lid' cannot be done"),
]


@pytest.mark.parametrize(("orders", "others", "message"), IMPOSSIBLE)
def test_a_task_that_nobody_can_do_is_refused(tmp_path, orders, others, message):
    transfer = LONG + "".join(f"{name},{name},0.5\n" for name in ("cup", "lid", "box"))
    with pytest.raises(InputError, match=re.escape(f"orders.csv, {message}")):
        read(tmp_path, orders, transfer, **others)


def test_a_lesson_in_time_makes_a_task_possible(tmp_path):
    orders = impossible("10,inf,inf,inf")
    late, early = LONG.replace("box,lid,0.6", "box,lid,1"), LONG.replace("cup,lid,0.4", "cup,lid,1")
    assert read(tmp_path, orders, late).shop.order == "any"
    assert read(tmp_path, orders, early, order="fixed").shop.order == "fixed"
    with pytest.raises(InputError, match="cannot be done"):
        read(tmp_path, orders, late, order="fixed")
    with pytest.raises(InputError, match="cannot be done"):
        read(tmp_path, orders, late, before="before,after\nlid,box\n")
    with pytest.raises(InputError, match="cannot be done"):
        read(tmp_path, orders, late, robots="robot,task,teachable\na,box,no\n")
    robots = "robot,task,skill,teachable\na,,0.9,\nb,,,no\n"
    with pytest.raises(
        InputError, match="cannot be done"
    ):  # the one that can be taught is not sure, the other not taught
        read(tmp_path, orders, late, robots=robots)


@pytest.mark.parametrize(
    ("settings_", "message"),
    [
        ({"order": "best"}, "order: 'best' is unknown"),
        ({"max_lessons": -1}, "max_lessons: -1 given"),
        ({"max_lessons": 1.5}, "max_lessons: 1.5 given; expected a whole number"),
        ({"max_teaching": math.nan}, "max_teaching: nan given"),
        ({"fill": 1.5}, "fill: 1.5 given"),
    ],
)
def test_settings_are_checked_first(tmp_path, settings_, message):
    with pytest.raises(ConfigError, match=re.escape(message)):
        read_shop(tmp_path / "absent.csv", None, **settings_)


def test_standard_input_is_read_once():
    with pytest.raises(InputError, match="standard input: can be read once"):
        read_shop("-", None, robots="-")


CELLS = {
    **{name: [*"abcabcabcd", ""] for name in ("taught", "tested", "task", "before", "after")},
    **{name: ["1", "2", "", "0"] for name in ("c_rob", "n")},
    **{name: ["1", "2", "3"] for name in ("successes", "attempts", "count")},
    "robot": ["a", "b", "robot"],
    "c_demo": ["1", "1", "", "2"],
    "demo_tries": ["", "", "2"],
    "decision": ["", "act", "delegate", "learn", "!learn"],
    "teachable": ["yes", "no", ""],
    "demo_success": ["1", "0.5", ""],
}


def cells(name):
    """Most of them such as a column holds."""
    usual = CELLS.get(name, ["0.5", "50%", "1", "0", "", "NA"])
    return st.sampled_from([*usual * 8, "x y", "-", "inf"])


def tables(columns, needed=()):
    """CSV text with some of these columns."""
    some = st.lists(st.sampled_from(columns), min_size=2, max_size=len(columns), unique=True)
    return some.map(lambda names: [*dict.fromkeys([*needed, *names])]).flatmap(
        lambda names: st.lists(st.tuples(*map(cells, names)), min_size=1, max_size=3, unique_by=lambda row: row[0]).map(
            lambda rows: "\n".join(";".join(row) for row in [names, *rows])
        )
    )


OTHERS = ("decision", "count", "teachable", "demo_success", "demo_tries", "family", "note")


@given(
    st.permutations(OTHERS).flatmap(
        lambda names: st.tuples(st.just(names[:2]), *[st.tuples(*map(cells, names[:2]))] * 3)
    ),
    st.one_of(
        tables(["robot", "c_demo", "n"], ["taught", "tested", "p"]),
        tables(["robot", "c_demo", "taught"], ["tested", "successes", "attempts"]),
        tables(["a", "b", "c", "d", "c_demo"], ["taught"]),
    ),
    st.none() | tables(["task", "c_rob", "skill", "c_demo", "teachable"], ["robot"]),
    st.none() | tables(["before", "after"]),
)
@settings(max_examples=150)
def test_whatever_the_cells_hold_there_is_a_shop_or_one_message(tmp_path_factory, others, transfer, robots, before):
    names, *rows = others
    header = ["task", "c_rob", "c_hum", "c_fail", "c_demo", *names]
    lines = [[name, *["1"] * 4, *row] for name, row in zip("abc", rows, strict=True)]
    orders = "\n".join(";".join(row) for row in [header, *lines])
    place = r"\S*(orders|transfer|robots|before)\.csv[:,] "
    try:
        day = read(tmp_path_factory.getbasetemp(), orders, transfer, robots=robots, before=before, fill=0.5)
        told = "transfer.csv: " if day.shop.transfer.shape == (len(day.shop.robots), len(day.shop.lessons), 3) else ""
    except InputError as problem:
        told = str(problem)
    assert re.match(place, told)


@pytest.mark.parametrize("transfer", [
    SQUARE.replace("\nlid", "\nlids"), SQUARE.replace(",lid", ",lids"), LONG.replace("lid,", "lids,"),
    LONG.replace(",lid,", ",lids,"),
])  # fmt: skip
def test_a_name_that_may_be_a_task_s_is_told_where_its_pairs_are_filled(tmp_path, transfer):
    hint = "in transfer.csv, 'lids' is no task of the orders; is it 'lid'?"
    assert hint in read(tmp_path, transfer=transfer, fill=0).remarks
    whole = LONG + "lids,cup,0.5\nlids,lid,0.5\n"  # of a catalogue, since the table has the lid, too
    assert not [each for each in read(tmp_path, transfer=whole, fill=0).remarks if "is it" in each]
