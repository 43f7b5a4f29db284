"""The stages `plan` and `check_plan` with an uncertain tomorrow: what is taken now, what can wait, and wrong input."""

import json

import pytest

from tests.stages.tables import rows_of

ORDERS = "task;c_rob;c_hum;c_fail;c_demo;Bay\ngear;10;100;100;150;A\n"
TRANSFER = "taught,tested,p\ngear,gear,0.9\ngear,lid,0\nlid,lid,0.9\nlid,gear,0\n"
TYPES = "task,c_rob,c_hum,c_fail,c_demo\ngear,10,100,100,150\nlid,10,100,100,150\n"
SCENARIOS = "scenario,task,count,probability\nbusy,gear,9,40%\nbusy,lid,9,\nquiet,gear,0,60%\n"
FORECAST = "task,mean,distribution\ngear,4,poisson\nlid,1,geometric\n"
FILES = {
    "orders": ORDERS, "transfer": TRANSFER, "types": TYPES, "scenarios": SCENARIOS, "forecast": FORECAST,
    "unknown": "scenario,task,count\n1,gear,1\n1,leed,2\n",
    "half": "scenario,task,count,probability\n1,gear,1,0.5\n",
}  # fmt: skip
OWN = ("tasks=orders.csv", "transfer=transfer.csv", "tomorrow=types.csv")


def test_lessons_now_and_lessons_that_can_wait(stage, tmp_path):
    """The gear is taught today, 150, which saves 0.4 · 130 more than it costs; the lid if it comes: 150 + 8 · 20."""
    code, told = stage("plan", *OWN, "scenarios=scenarios.csv")
    assert code == 0, told.err
    rows = {row["lesson"]: row for row in rows_of(tmp_path / "out/tomorrow.csv")}
    assert rows["gear"]["when"] == "now"
    assert float(rows["gear"]["saving"]) == pytest.approx(100 + 0.4 * 310 - (150 + 0.4 * 180))
    assert (rows["lid"]["when"], rows["lid"]["share_taught_tomorrow"]) == ("can wait", "0.4")
    summary = json.loads((tmp_path / "out/plan.json").read_text(encoding="utf-8"))
    assert summary["cost_today"] == 150
    assert summary["cost_tomorrow"] == pytest.approx(0.4 * (180 + 310))
    assert [each["scenario"] for each in summary["scenarios"]] == ["busy", "quiet"]
    assert "today 150.0, tomorrow 196.0" in told.out
    assert "taught in 40.0% of cases" in told.out
    assert "Bay" in (tmp_path / "out/plan.csv").read_text(encoding="utf-8")
    assert "40.0%" in (tmp_path / "out/plan.html").read_text(encoding="utf-8")
    code, told = stage("check_plan", *OWN, "scenarios=scenarios.csv", "plan=out", out="check")
    assert code == 0, told.err
    assert "1 tasks, order fixed; 2 scenarios of tomorrow; costs 346; no plan costs less than 346: optimal." in told.out
    assert "plan.html shows these costs and this day." in told.out
    assert "2 lessons recomputed, what they save solved for again, all are the same." in told.out
    code, told = stage("check_plan", *OWN, "scenarios=scenarios.csv", "plan=out", "reasons_s=0", out="check")
    assert (code, "savings of 1 were not compared, for want of time" in told.out) == (0, True)


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("gear,robot,now", "gear,robot,can wait", "a row for 'gear' is missing"),
        (",150,gear,", ",140,gear,", "row 2, column 'c_demo': is not what the plan says (150.0)"),
        (",gear,3.6,", ",lid,3.6,", "row 2, column 'serves_today'"),
        (",gear,3.6,", ",gear,3.7,", "row 2, column 'uses_tomorrow'"),
        (",,0.4,", ",,0.5,", "row 3, column 'share_taught_tomorrow'"),
        ("lid,robot,can wait,150,,,0.4,\n", "", "a row for 'lid' is missing"),
        ("lid,robot", "gear,robot", "a row for 'lid' is missing"),
        ("{saving}", "3", "row 2, column 'saving': is not what solving again gives"),
    ],
)
def test_a_lesson_that_was_changed_is_found_with_its_row_and_field(stage, tmp_path, old, new, part):
    """Nobody looked at tomorrow.csv; here plan.json, which has the same lessons, is changed alike."""
    assert stage("plan", *OWN, "scenarios=scenarios.csv")[0] == 0
    table, summary = tmp_path / "out/tomorrow.csv", tmp_path / "out/plan.json"
    text, facts = table.read_text(encoding="utf-8"), json.loads(summary.read_text(encoding="utf-8"))
    old = old.format(saving=text.splitlines()[1].rpartition(",")[2])
    assert old in text
    table.write_text(text.replace(old, new, 1), encoding="utf-8")
    check = ("check_plan", *OWN, "scenarios=scenarios.csv", "plan=out")
    code, told = stage(*check, out="check")
    assert (code, "tomorrow.csv: is not what plan.json says" in told.err) == (2, True)
    facts["lessons"] = lessons_of(table)
    summary.write_text(json.dumps(facts), encoding="utf-8")
    code, told = stage(*check, out="check")
    assert (code, part in told.err) == (2, True), told.err


def lessons_of(path):
    """The lessons of plan.json that tomorrow.csv is written from."""
    numbers = ("c_demo", "uses_tomorrow", "share_taught_tomorrow", "saving")
    return [
        {**row, **{name: float(row[name]) if row[name] else None for name in numbers}}
        | {"serves_today": row["serves_today"].split("; ") if row["serves_today"] else []}
        for row in rows_of(path)
    ]


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        ("<b>346.0</b>", "<b>345.0</b>", "does not show the cost of this plan"),
        ("proven optimal", "the best found", "does not show the cost of this plan"),
        ("Today 150.0", "Today 140.0", "does not show the costs of the two days"),
        ("100%", "99%", "does not show the day of this plan"),
    ],
)
def test_a_page_that_shows_something_else_is_told(stage, tmp_path, old, new, part):
    assert stage("plan", *OWN, "scenarios=scenarios.csv")[0] == 0
    page = tmp_path / "out/plan.html"
    text = page.read_text(encoding="utf-8")
    assert old in text
    page.write_text(text.replace(old, new), encoding="utf-8")
    check = ("check_plan", *OWN, "scenarios=scenarios.csv", "plan=out")
    code, told = stage(*check, out="check")
    assert (code, f"plan.html: {part}" in told.err) == (2, True), told.err
    page.unlink()
    code, told = stage(*check, out="check")
    assert (code, "plan.html" in told.out) == (0, False)
    (tmp_path / "out/tomorrow.csv").unlink()
    code, told = stage(*check, out="check")
    assert (code, "tomorrow.csv: cannot be read as the lessons of a plan" in told.err) == (2, True)


def test_a_forecast_is_sampled_and_its_error_said(stage, tmp_path):
    code, told = stage("plan", *OWN, "forecast=forecast.csv", "samples=40", "replications=4", "commit=all")
    assert code == 0, told.err
    assert "Over 4 fresh samples tomorrow costs" in told.out
    assert "No lesson is given tomorrow (commit=all)." in told.out
    code, told = stage("check_plan", *OWN, "forecast=forecast.csv", "plan=out", out="check")
    assert code == 0, told.err
    path = tmp_path / "out/plan.json"
    summary = json.loads(path.read_text(encoding="utf-8"))
    assert summary["setting"] == {"commit": "all", "samples": 40, "seed": 0}
    summary["objective"] *= 0.9
    path.write_text(json.dumps(summary), encoding="utf-8")
    code, told = stage("check_plan", *OWN, "forecast=forecast.csv", "plan=out", out="check")
    assert code == 2
    assert "objective is not what" in told.err


@pytest.mark.parametrize(
    ("words", "told_that"),
    [
        (("scenarios=unknown.csv",), "unknown.csv, row 3, column 'task': 'leed' is no task that may come"),
        (("scenarios=half.csv",), "half.csv, row 2, column 'probability': the probabilities of the 1 scenarios sum to"),
        (("scenarios=scenarios.csv", "forecast=forecast.csv"), "give one of them"),
        (("forecast=forecast.csv", "planner=highs"), "an uncertain tomorrow has planner=auto"),
        (("forecast=forecast.csv", "replications=1"), "an interval needs at least two"),
        (("scenarios=scenarios.csv", "replications=2"), "needs at least 4 scenarios, and there are 2"),
        ((), "give scenarios=… or forecast=…"),
    ],
)
def test_a_wrong_tomorrow_is_one_message(stage, tmp_path, words, told_that):
    code, told = stage("plan", *OWN, *words)
    assert code == 2
    assert told_that in told.err
    assert "Traceback" not in told.err
    assert not (tmp_path / "out/plan.csv").exists()


def test_a_plan_of_both_days_needs_its_future(stage):
    assert stage("plan", *OWN, "scenarios=scenarios.csv")[0] == 0
    code, told = stage("check_plan", *OWN[:2], "plan=out", out="check")
    assert code == 2
    assert "is for today and tomorrow; give its scenarios" in told.err


def test_a_limit_that_leaves_no_lesson_is_named(stage):
    code, told = stage("plan", *OWN, "scenarios=scenarios.csv", "commit=all", "max_lessons=0")
    assert code == 0, told.err
    assert "No lesson pays within max_lessons=0, neither today nor tomorrow." in told.out
