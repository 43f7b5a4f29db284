"""The stages `plan` and `check_plan` with an uncertain tomorrow: what is taken now, what can wait, and wrong input."""

import csv
import importlib
import json

import pytest

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


def test_lessons_now_and_lessons_that_can_wait(stage, tmp_path):
    """The gear is taught today, 150, which saves 0.4 · 130 more than it costs; the lid if it comes: 150 + 8 · 20."""
    code, told = stage("plan", *OWN, "scenarios=scenarios.csv")
    assert code == 0, told.err
    with (tmp_path / "out/tomorrow.csv").open(encoding="utf-8") as stream:
        rows = {row["lesson"]: row for row in csv.DictReader(stream)}
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
