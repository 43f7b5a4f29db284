"""The stages from a person's tables to a plan that is checked: copies, robots, a partial order, limits, gaps."""

import csv
import importlib
import json
from pathlib import Path

import pytest

from examples.shop import make

SHOP_FOLDER = Path(make.__file__).parent
SHOP = {name: SHOP_FOLDER / f"{name}.csv" for name in ("features", "trials", "orders", "before", "robots")}
ORDERS = """Task;C_rob;C_hum;C_fail;C_demo;Count;Decision;Bay
gear;10;100;100;120;1;;A
cog;10;100;100;130;1;delegate;B
lid;10;100;100;200;5;;C
nut;1,5;100;100;200;1;act;D
"""  # of an Excel with decimal commas
TRANSFER = "taught,tested,p\ngear,lid,0.9\ncog,lid,0.85\ngear,nut,0.9\nlid,nut,0.2\n"
BEFORE = "before,after\nlid,nut\n"
ROBOTS = "robot,c_rob,c_demo\nPanda,,\nAda,5,never\n"
FEATURES = "task;mm;family\ngear;10;wheel\ncog;9,5;wheel\nlid;80;cover\nnut;3,5;nut\n"
TRIALS = "taught\ttested\tsuccesses\tattempts\ngear\tlid\t4\t5\ncog\tlid\t3\t5\n"
FILES = {
    "orders": ORDERS, "transfer": TRANSFER, "before": BEFORE, "robots": ROBOTS, "features": FEATURES, "trials": TRIALS,
    "few": "task,c_rob,c_hum,c_fail,c_demo\ngear,10,100,100,120\nlid,10,100,100,200\n",
    "square": "task,gear,lid\ngear,1,0.9\nlid,0,1\n",
    "must": "task,c_rob,c_hum,c_fail,c_demo,decision\ngear,10,100,100,120,learn\nlid,10,100,100,200,learn\n",
    "misspelt": FEATURES.replace("\nlid", "\nlidd"),
    "circle": "before,after\nlid,nut\nnut,lid\n",
}  # fmt: skip
OWN = ("tasks=orders.csv", "transfer=transfer.csv")
ALL = ("before=before.csv", "robots=robots.csv", "fill=0")


@pytest.fixture
def stage(tmp_path, monkeypatch, capsys):
    """Run a stage in a folder with these files; gives exit code and what it printed."""
    for name, text in FILES.items():
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")

    def run(name, *words, out="out"):
        monkeypatch.setattr("sys.argv", [name, *words, "tracking=disabled", f"hydra.run.dir={tmp_path / out}"])
        with pytest.raises(SystemExit) as left:
            importlib.import_module(f"stages.{name}").run()
        return left.value.code, capsys.readouterr()

    return run


def rows_of(path):
    with path.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_a_day_with_everything_is_planned_and_checked(stage, tmp_path):
    """Panda is taught the gear (120), does five lids for 20 each and the nut for 1.5 + 0.1 · 100; the cog costs 100."""
    code, told = stage("plan", *OWN, *ALL, "max_lessons=1")
    assert code == 0, told.err
    rows = rows_of(tmp_path / "out/plan.csv")
    assert list(rows[0]) == [
        "order",
        "task",
        "count",
        "decision",
        "robot",
        "skill",
        "p_success",
        "expected_cost",
        "Bay",
    ]
    day = {row["task"]: row for row in rows}
    assert [day["gear"][name] for name in ("decision", "robot", "expected_cost", "Bay")] == [
        "learn",
        "Panda",
        "120",
        "A",
    ]
    assert [day["cog"][name] for name in ("decision", "robot", "expected_cost")] == ["delegate", "", "100"]
    assert [day["lid"][name] for name in ("decision", "robot", "skill", "count", "expected_cost")] == [
        "act", "Panda", "gear", "5", "100",
    ]  # fmt: skip
    assert [day["nut"][name] for name in ("decision", "robot", "expected_cost")] == ["act", "Panda", "11.5"]
    assert int(day["gear"]["order"]) < int(day["lid"]["order"]) < int(day["nut"]["order"])
    assert "Note: " in told.out
    assert "fill=0" in told.out
    assert "Expected cost 331.5 (proven optimal)" in told.out
    assert {path.name for path in (tmp_path / "out").iterdir()} >= {
        "plan.csv", "plan.json", "plan.html", "plan.png", "reasons.csv", "certificate.npz",
    }  # fmt: skip
    assert json.loads((tmp_path / "out/plan.json").read_text())["max_lessons"] == 1.0

    code, told = stage("check_plan", *OWN, *ALL, "plan=out", out="checked")
    assert code == 0, told.err
    assert "8 tasks, order partial; costs 331.5; no plan costs less than 331.5: optimal" in told.out
    assert "plan.html shows this cost and this day" in told.out
    assert "numbers solved for again, all are the same." in told.out
    for name, old, new in (
        ("reasons.csv", "gear,Panda,yes,120,", "gear,Panda,yes,12,"),
        ("plan.html", "331.5", "33.5"),
    ):
        text = (tmp_path / "out" / name).read_text(encoding="utf-8")
        assert old in text
        (tmp_path / "out" / name).write_text(text.replace(old, new, 1), encoding="utf-8")
        code, told = stage("check_plan", *OWN, *ALL, "plan=out", out="checked")
        assert (code, "Traceback" in told.err, name in told.err, told.out) == (2, False, True, "")
        (tmp_path / "out" / name).write_text(text, encoding="utf-8")
    for old, new in ((";5;;C", ";4;;C"), ("cog;10;100", "cog;10;101"), (";120;", ";119;"), ("nut", "bolt")):
        (tmp_path / "orders.csv").write_text(ORDERS.replace(old, new))
        code, told = stage("check_plan", *OWN, *ALL, "plan=out", out="checked")
        assert (code, "Traceback" in told.err, told.out) == (2, False, ""), new
    (tmp_path / "orders.csv").write_text(ORDERS)
    for words in (ALL[:2], ALL[1:], (ALL[0], ALL[2])):
        code, told = stage("check_plan", *OWN, *words, "plan=out", out="checked")
        assert (code, "Traceback" in told.err, told.out) == (2, False, ""), words


def test_pairs_that_nobody_tried_are_predicted(stage, tmp_path):
    words = (*OWN, "features=features.csv", "trials=trials.csv")
    code, told = stage("plan", *words)
    assert code == 0, told.err
    assert "has no value in transfer.csv; predicted" in told.out
    code, told = stage("check_plan", *words, "plan=out", out="checked")
    assert code == 0, told.err
    assert ": optimal." in told.out


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        ((*OWN, *ALL, "order=any"), ("order=any and before=", "leave one out")),
        ((*OWN, "fill=0", "planner=facility"), ("planner=facility", "use planner=auto")),
        ((*OWN, "fill=0", "planner=gut_feeling"), ("gut_feeling", "auto")),
        (OWN, ("transfer.csv", "has no value for", "fill=0", "features=")),
        ((*OWN, "fill=2"), ("fill",)),
        ((*OWN, "fill=0,05"), ("stage plan: fill=0,05: a comma makes a list here; write fill=0.05\n",)),
        ((*OWN, "fill=,5"), ("write fill=0.5",)),
        ((*OWN, "fill=5,0%"), ("write fill=0.05",)),
        ((*OWN, "fill=0", "max_lessons=1.5"), ("max_lessons", "1.5", "integer")),
        (
            (*OWN, "features=misspelt.csv"),
            ("misspelt.csv, column 'task': has no row for 'lid'", "is it 'lidd'?"),
        ),
        ((*OWN, "fill=0", "max_lessons=-1"), ("max_lessons",)),
        ((*OWN, "fill=0", f"max_lessons=1{'0' * 30}"), ("max_lessons", "less than or equal to 1000000")),
        (
            ("tasks=must.csv", "transfer=square.csv", "max_lessons=1"),
            (
                "no plan keeps the limits and the decisions",
                "2 tasks are to be taught",
                "max_lessons is 1",
            ),
        ),
        (
            ("tasks=must.csv", "transfer=square.csv", "max_teaching=300"),
            ("the lessons to be given take 320 at least, and max_teaching is 300",),
        ),
        ((*OWN, "fill=0", "before=circle.csv"), ("circle", "lid", "nut")),
        ((*OWN, "fill=0", "robots=features.csv"), ("features.csv", "column 'robot'")),
        ((*OWN, "features=features.csv", "trials=transfer.csv"), ("transfer.csv", "expected taught,tested,successes")),
        (("tasks=-", "transfer=transfer.csv", "features=-"), ("standard input", "can be read once")),
        (("tasks=few.csv", "transfer=square.csv", "features=nowhere.csv"), ("nowhere.csv", "no such file")),
        (("before=before.csv",), ("before", "only for your own tasks")),
        (("tasks=orders.csv",), ("transfer is missing",)),
    ],
)
def test_a_mistake_is_one_message_and_nothing_is_written(stage, tmp_path, words, parts):
    code, told = stage("plan", *words)
    assert code == 2
    assert "Traceback" not in told.err
    for part in parts:
        assert part in told.err
    assert not (tmp_path / "out").exists()


def test_the_help_fits_a_screen(stage):
    code, told = stage("plan", "--help")
    lines = told.out.splitlines()
    assert code == 0
    assert len(lines) <= 40
    assert max(map(len, lines)) <= 120
    for name in ("before=", "robots=", "fill=", "features=", "max_lessons=", "max_teaching=", "decision", "count"):
        assert name in told.out


def test_the_example_s_shop_from_trials_to_a_plan_that_is_checked(stage, tmp_path):
    code, told = stage(
        "predict_transfer", *(f"{name}={SHOP[name]}" for name in ("features", "trials")), "out=table.csv", out="table"
    )
    assert code == 0, told.err
    words = (f"tasks={SHOP['orders']}", "transfer=table.csv", f"before={SHOP['before']}", f"robots={SHOP['robots']}")
    code, told = stage("plan", *words)
    assert code == 0, told.err
    headline = next(line for line in told.out.splitlines() if line.startswith("Expected cost"))
    assert headline in (SHOP_FOLDER.parents[1] / "docs/your-tasks.md").read_text(encoding="utf-8")
    given = {row["lesson"] for row in rows_of(tmp_path / "out/reasons.csv") if row["given"] == "yes"}
    assert given & set(make.CATALOGUE)  # a lesson that is on no order of today
    tasks = [row["task"] for row in rows_of(tmp_path / "out/plan.csv")]
    for row in rows_of(SHOP["before"]):
        assert tasks.index(row["before"]) < tasks.index(row["after"])
    code, told = stage("check_plan", *words, "plan=out", out="checked")
    assert code == 0, told.err
    assert "order partial" in told.out
    assert ": optimal." in told.out


def test_the_example_s_day_with_its_two_surprises(stage):
    """Of the plan without `robots=`, as the docs say."""
    table = ("predict_transfer", *(f"{name}={SHOP[name]}" for name in ("features", "trials")), "out=table.csv")
    assert stage(*table, out="table")[0] == 0
    words = (f"tasks={SHOP['orders']}", "transfer=table.csv", f"before={SHOP['before']}", "reasons_s=0")
    code, told = stage("plan", *words)
    assert code == 0, told.err
    assert told.out.count("Expected cost 302.0 (proven optimal)") == 1
    outcomes = Path(SHOP["orders"]).with_name("outcomes.csv")
    code, told = stage("day", "plan=out", f"outcomes={outcomes}", out="day")
    assert code == 0, told.err
    assert "8. bearing_3: not taught; expected cost of the day 295.3 -> 319.5\n  new lesson: bearing_1 (" in told.out
    assert "43. connector_2: failure; expected cost of the day 216.7 -> 238.4 (240.0 if the plan were kept)" in told.out
    assert "The day is done: 46 outcomes, cost 223.0." in told.out


def test_a_failure_that_is_cheaper_than_handing_over_is_named_and_changes_nothing(stage, tmp_path):
    """An attempt at the gear that fails costs 10 + 80, the person 100; of the lid both cost 100."""
    (tmp_path / "cheap.csv").write_text(
        "task,c_rob,c_hum,c_fail,c_demo\ngear,10,100,80,120\nlid,10,100,90,200\nnut,10,never,1,9\ncog,never,9,1,9\n"
    )
    code, told = stage("plan", "tasks=cheap.csv", "transfer=transfer.csv", "fill=0")
    assert code == 0, told.err
    note = "a failed attempt (c_rob + c_fail) costs less than handing over (c_hum) at 'gear'; c_fail has to hold"
    assert f"Note: {note}" in told.out
    assert "a failed attempt (c_rob + c_fail)" in (tmp_path / "out/plan.html").read_text(encoding="utf-8")
    assert "Expected cost 157.0 (proven optimal)" in told.out
    assert stage("check_plan", "tasks=cheap.csv", "transfer=transfer.csv", "fill=0", "plan=out", out="check")[0] == 0
    (tmp_path / "future.csv").write_text("scenario,task,count\n1,gear,1\n")
    (tmp_path / "cheap.csv").write_text("task,c_rob,c_hum,c_fail,c_demo\ngear,10,100,80,120\n")
    (tmp_path / "then.csv").write_text("task,c_rob,c_hum,c_fail,c_demo\ngear,10,100,100,120\nlid,1,9,7,never\n")
    words = ("tasks=cheap.csv", "transfer=transfer.csv", "fill=0", "tomorrow=then.csv", "scenarios=future.csv")
    code, told = stage("plan", *words, out="both")
    assert "at 'gear', 'lid'; c_fail has to hold" in told.out


CHANGES = [
    ("orders", ("gear;10;100;100;120", "gear;10;99,5;100;120"), "c_hum of 'gear' is 99.5, and was 100"),
    ("orders", ("gear;10;100;100;120", "gear;10;100;100;121"), "c_demo of 'gear' (Panda) is 121, and was 120"),
    ("orders", ("lid;10;100;100;200;5", "lid;10;100;100;200;4"), "count of 'lid' is 4, and was 5"),
    ("orders", (";;C", ";;X"), "other cells in 'Bay'"),
    ("orders", ("cog;10", "dog;10"), "tasks: 'cog' missing, 'dog' new"),
    (
        "transfer",
        ("gear,lid,0.9", "gear,lid,0.8"),
        "transfer of a lesson on 'gear' to 'lid' (Panda) is 0.8, and was 0.9",
    ),
    ("before", ("lid,nut", "nut,gear"), "the partial order (before=…) has other rows"),
]


@pytest.mark.parametrize(("name", "change", "what"), CHANGES)
def test_a_plan_of_other_tables_is_told_by_what_is_other(stage, tmp_path, name, change, what):
    assert stage("plan", *OWN, *ALL)[0] == 0
    text = FILES[name].replace(*change)
    assert text != FILES[name]
    (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    if "dog" in text:
        (tmp_path / "transfer.csv").write_text(TRANSFER.replace("cog", "dog"), encoding="utf-8")
    code, told = stage("check_plan", *OWN, *ALL, "plan=out", out="check")
    assert code == 2
    assert f"stage check_plan: plan=out: was made from other tables: {what}; give the tables" in told.err


def test_a_plan_of_several_robots_is_not_one_of_a_single_one(stage):
    """`tuple index out of range` it said."""
    assert stage("plan", *OWN, *ALL)[0] == 0
    code, told = stage("check_plan", *OWN, "before=before.csv", "fill=0", "plan=out", out="check")
    assert (code, "robots: 'Panda', 'Ada' missing, 'robot' new" in told.err) == (2, True)


def test_an_unknown_planner_is_that_before_it_is_one_that_cannot(stage):
    code, told = stage("plan", *OWN, "fill=0", "planner=foo")
    assert (code, "unknown planner 'foo'; known: ad, alm, auto" in told.err) == (2, True)


def test_a_key_that_there_is_not_is_told_with_the_one_that_is_meant(stage):
    code, told = stage("plan", *OWN, "fill=0", "foercast=x.csv")
    assert code == 2
    assert "stage plan: foercast: unknown key; did you mean 'forecast'? allowed: before, commit" in told.err
    assert "+foercast" not in told.err
    assert "domain.nme: unknown key; did you mean 'name'?" in stage("plan", "domain.nme=lego")[1].err
    assert "+domain.params.taps" in stage("plan", "domain.params.taps=3")[1].err  # which may be there


def test_a_folder_that_is_a_file_is_called_so(stage, tmp_path):
    for out, what in (("orders.csv", "is a file"), ("orders.csv/in", "is in a file")):
        code, told = stage("plan", *OWN, "fill=0", out=out)
        assert (code, f"{out}: {what}; give a folder" in told.err, "Errno" in told.err) == (2, True, False)
