"""The stage that says what to ask a person next: by hand, to the end, and with mistakes in its tables."""

import shutil
from pathlib import Path

import pytest

from examples.shop import make
from tests.stages.tables import rows_of

SHOP = Path(make.__file__).parent
FILES = {
    "orders": "task,c_rob,c_hum,c_fail,c_demo,family,bay\npeg,10,50,100,100,pegs,A\npin,10,60,100,100,pegs,B\n"
    "lid,10,30,100,100,lids,C\nbox,10,never,0,100,pegs,D\nnut,10,5,100,100,,E\n",
    "transfer": "taught,tested,p\npeg,pin,1\npin,peg,1\n",
    "prior": "family,cost,probability\npegs,140,50%\npegs,20,50%\n",
    "summed": "family;mean;sd;distribution\npegs;80,5;60;gamma\nlids;30;0;\n",
    "said": "family,c_hum\npegs,20\n",
    "bare": "task,c_rob,c_hum,c_fail,c_demo\npeg,10,50,100,100\n",
}
OWN = ("tasks=orders.csv", "transfer=transfer.csv", "fill=0")


def test_a_question_is_told_with_its_worth_and_the_plan_without_it(stage, tmp_path):
    """At 80 a lesson does both pegs, 110; at 20 the person, 40: 35. Lid 30, nut 5, box 10."""
    code, told = stage("ask", *OWN, "prior=prior.csv", "c_ask=20")
    assert code == 0, told.err
    assert "Expected cost 155.0 (proven optimal)" in told.out
    assert "Note: prior.csv does not have 'lids'; their c_hum is that of the orders" in told.out
    assert "Note: the person cannot do 'box'" in told.out
    assert "of 'pegs'? The answer is worth 35.0 and costs 20.0" in told.out
    [row] = rows_of(tmp_path / "out" / "questions.csv")
    assert [row[name] for name in ("family", "tasks", "answered", "mean", "value", "net")] == [
        "pegs", "2", "no", "80", "35", "15",
    ]  # fmt: skip
    code, told = stage("ask", *OWN, "prior=prior.csv", "c_ask=36", out="dear")
    assert "No question is worth its cost of 36.0; the best, 'pegs', is worth 35.0." in told.out


def test_after_the_answer_it_goes_on_to_the_end_and_the_orders_are_those_of_the_plan(stage, tmp_path):
    words = (*OWN, "prior=prior.csv", "c_ask=20", "answers=said.csv")
    code, told = stage("ask", *words)
    assert code == 0, told.err
    assert "Expected cost 85.0 (proven optimal)" in told.out
    assert "answered" in told.out
    assert "No question is worth its cost" in told.out
    out = tmp_path / "out"
    orders = rows_of(out / "expected_orders.csv")
    assert [row["c_hum"] for row in orders] == ["20", "20", "30", "never", "5"]
    assert [row["bay"] for row in orders] == list("ABCDE")
    kept = {path.name: path.read_bytes() for path in out.glob("*.csv")}
    code, _ = stage("ask", *words)  # nothing is remembered but the answers
    assert code == 0
    assert {path.name: path.read_bytes() for path in out.glob("*.csv")} == kept
    mine = ("tasks=out/expected_orders.csv", *OWN[1:])
    code, told = stage("check_plan", *mine, "plan=out")
    assert code == 0, told.err
    assert "costs 85; no plan costs less than 85: optimal" in told.out
    code, told = stage("plan", *mine, out="again")
    assert "Expected cost 85.0" in told.out


def test_a_table_with_decimal_commas_and_a_distribution(stage, tmp_path):
    orders = FILES["orders"].replace(",", ";").replace("10;50", "10;50,5")
    (tmp_path / "orders.csv").write_text(orders, encoding="utf-8")
    code, told = stage("ask", *OWN, "prior=summed.csv", "c_ask=1", "look_ahead=2", "noise=5")
    assert code == 0, told.err
    assert [row["mean"] for row in rows_of(tmp_path / "out" / "questions.csv")] == ["80.5", "30"]
    assert (tmp_path / "out" / "expected_orders.csv").read_text().splitlines()[1] == "peg;10;80,5;100;100;pegs;A"
    (tmp_path / "said.csv").write_text("family,c_hum\npegs,20\npegs,25\n")  # asked twice, since answers are not exact
    code, told = stage("ask", *OWN, "prior=summed.csv", "c_ask=1", "noise=30", "answers=said.csv")
    assert code == 0, told.err


@pytest.mark.parametrize(
    ("name", "text", "parts"),
    [
        ("prior", "family,mean,sd\npegs,-5,1\n", ("prior.csv, row 2, column 'mean'", "'-5'", "from 0")),
        ("prior", "family,mean,sd\npegs,0,1\n", ("prior.csv, row 2, column 'sd'", "no spread")),
        ("prior", "family,mean,sd\npeg,5,1\n", ("row 2, column 'family'", "not in orders.csv; is it 'pegs'?")),
        ("prior", "family,mean,sd\npegs,5,1\npegs,6,1\n", ("row 3, column 'family'", "appears twice")),
        ("prior", "family,mean,sd,distribution\npegs,5,1,cauchy\n", ("column 'distribution'", "lognormal, gamma")),
        ("prior", "family,cost,probability\nlids,1,1\npegs,5,0.5\npegs,6,0.4\n", ("row 3, column 'prob", "to 0.9")),
        ("prior", "family,cost,probability\npegs,-5,1\n", ("row 2, column 'cost'", "'-5'")),
        ("prior", "family,cost,probability\npegs,5,0.5\npegs,5,0.5\n", ("row 3, column 'cost'", "twice")),
        (
            "prior", "family,cost,probability\n" + "".join(f"pegs,{cost},0.001\n" for cost in range(1001)),
            ("row 2, column 'cost'", "1001 costs; give at most 1000"),
        ),
        ("prior", "family,price\npegs,5\n", ("prior.csv, row 1", "family,mean,sd[,distribution] or family,cost,")),
        ("prior", "family,mean,cost\npegs,5,5\n", ("prior.csv, row 1", "expected")),
        ("prior", "family,mean,sd\n", ("prior.csv", "no families")),
        ("said", "family,c_hum\nlids,3\n", ("said.csv, row 2, column 'family'", "'lids' is not in prior.csv")),
        ("said", "family,c_hum\npegs,50\n", ("row 2, column 'c_hum'", "50 is none of the costs", "(20, 140)")),
        ("said", "family,c_hum\npegs,-1\n", ("said.csv, row 2, column 'c_hum'", "'-1'")),
        ("said", "family,c_hum\npegs,never\n", ("said.csv, row 2, column 'c_hum'", "'never'")),
        ("said", "family,c_hum\npegs,20\npegs,20\n", ("said.csv, row 3, column 'family'", "answered twice")),
        ("said", "family,cost\npegs,20\n", ("said.csv, row 1, column 'c_hum'", "missing")),
        ("orders", FILES["bare"], ("orders.csv, row 1, column 'family'", "missing")),
    ],
)  # fmt: skip
def test_a_mistake_in_a_table_is_one_message_with_file_row_and_field(stage, tmp_path, name, text, parts):
    (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    code, told = stage("ask", *OWN, "prior=prior.csv", "c_ask=1", "answers=said.csv")
    assert code == 2
    assert "Traceback" not in told.err
    for part in parts:
        assert part in told.err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "part"),
    [
        (("c_ask=-1",), "c_ask"),
        (("c_ask=1", "look_ahead=4"), "look_ahead"),
        (("c_ask=1", "order=any", "before=before.csv"), "leave one out"),
        (("c_ask=1", "tasks=-"), "read twice"),
        (("c_ask=1", "points=0"), "points: given '0'"),
        (("c_ask=1", "points=100000"), "points: given '100000'; input should be less than or equal to 1000"),
        (("c_ask=1", "max_lessons=1.5"), "max_lessons: given '1.5'"),
        (("c_ask=1", "max_lessons=1000000000000000000000000000000"), "max_lessons: given '1000"),
    ],
)
def test_a_wrong_setting_is_refused(stage, words, part):
    code, told = stage("ask", *OWN, "prior=prior.csv", *words)
    assert (code, part in told.err) == (2, True)


def test_the_help_is_one_screen(stage):
    code, told = stage("ask", "--help")
    assert code == 0
    assert len(told.out.splitlines()) <= 24
    assert all(each in told.out for each in ("prior.csv:", "answers.csv:", "c_ask=5", "questions.csv"))


def test_an_input_is_not_overwritten(stage, tmp_path):
    (tmp_path / "out").mkdir()
    shutil.copy(tmp_path / "orders.csv", tmp_path / "out" / "expected_orders.csv")
    code, told = stage("ask", "tasks=out/expected_orders.csv", *OWN[1:], "prior=prior.csv", "c_ask=1")
    assert code == 2
    assert "would be overwritten" in told.err
    assert (tmp_path / "out" / "expected_orders.csv").read_text() == FILES["orders"]


def test_the_shop_s_prior_has_a_question_that_is_worth_asking(stage, tmp_path):
    words = [f"tasks={SHOP}/orders.csv", f"before={SHOP}/before.csv", f"prior={SHOP}/prior.csv", "transfer=own.csv"]
    names = [row["task"] for row in rows_of(SHOP / "orders.csv")]
    alike = [(one, other) for one in names for other in names if one.split("_")[0] == other.split("_")[0]]
    (tmp_path / "own.csv").write_text("taught,tested,p\n" + "".join(f"{a},{b},0.9\n" for a, b in alike))
    code, told = stage("ask", *words, "fill=0.1", "c_ask=1", "points=3", "reasons_s=0")
    assert code == 0, told.err
    assert "Next question: what does it cost you" in told.out
    assert len(rows_of(tmp_path / "out" / "questions.csv")) == 9


def test_failures_are_compared_with_what_is_believed(stage, tmp_path):
    """Pegs are believed to cost 80, and then 20; their failures cost 10 + 60, where the orders say 50."""
    words = ("tasks=orders.csv", "transfer=transfer.csv", "fill=0", "prior=prior.csv", "c_ask=20")
    orders = FILES["orders"].replace("peg,10,50,100", "peg,10,50,60")
    (tmp_path / "orders.csv").write_text(orders, encoding="utf-8")
    assert "costs less than handing over (c_hum) at 'peg';" in stage("ask", *words)[1].out
    assert "costs less than handing over" not in stage("ask", *words, "answers=said.csv", out="again")[1].out
