"""A day walked through by its stage: from a file, at the terminal, cut anywhere, corrected, and with wrong rows."""

import importlib
import io
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from mlflow import MlflowClient

ROOT = Path(__file__).resolve().parents[2]
FILES = {
    "orders": "task,c_rob,c_hum,c_fail,c_demo,count,bay\npeg,1,9,9,8,3,=A\nlid,1,5,9,30,2,B\nnut,1,7,9,30,1,C\n",
    "transfer": "taught,tested,p,n\npeg,peg,0.9,4\npeg,lid,0.7,1\npeg,nut,0.6,1\n",
}
OUTCOMES = "task,outcome,note\npeg,done,\n,failure,slipped\n,success,\nlid,failure,\n"
HEADER = "step,task,copy,decision,robot,lesson,outcome,note,plan"


def ended(name, *words):
    """Exit code of a stage that is run here; nothing is tracked unless a store is named."""
    tracking = () if any(word.startswith("tracking.") for word in words) else ("tracking=disabled",)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.argv", [name, *words, *tracking])
        patch.setenv("HYDRA_FULL_ERROR", "1")
        patch.setenv("P2L_STOPPED", "")  # what a stopped stage leaves for the end of its process, which this is not
        with pytest.raises(SystemExit) as left:
            importlib.import_module(f"stages.{name}").run()
    return left.value.code


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """A folder with tables and the plan of them."""
    folder = tmp_path_factory.mktemp("planned")
    for name, text in {**FILES, "outcomes": OUTCOMES}.items():
        (folder / f"{name}.csv").write_text(text, encoding="utf-8")
    tables = (f"tasks={folder / 'orders.csv'}", f"transfer={folder / 'transfer.csv'}")
    assert ended("plan", *tables, "fill=0", f"hydra.run.dir={folder / 'plan'}") == 0
    return folder


@pytest.fixture
def stage(planned, tmp_path, monkeypatch, capsys):
    """Run a stage in a folder with a plan; gives exit code and what it printed."""
    shutil.copytree(planned, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    capsys.readouterr()

    def run(name, *words, typed=""):
        monkeypatch.setattr("sys.stdin", io.StringIO(typed))
        return ended(name, *words), capsys.readouterr()

    return run


def table(path):
    return [line.split(",")[:-1] for line in path.read_text(encoding="utf-8").splitlines()]


def test_a_whole_day_and_its_files(stage, tmp_path):
    """The morning's tables are gone by then; a changed one would be another day's."""
    for name in FILES:
        (tmp_path / f"{name}.csv").unlink()
    code, told = stage("day", "plan=plan", "outcomes=outcomes.csv")
    assert code == 0, told.err
    lines = told.out.splitlines()
    assert lines[0] == "1. peg: done; no change; expected cost of the day 23.8"
    assert lines[3].startswith("4. lid: failure; expected cost of the day ")
    assert "the lesson on peg -> the person" in told.out
    assert lines[-2].startswith("2 tasks are left after 4 outcomes. Spent 29.0, expected for the rest ")
    day = tmp_path / "plan" / "day"
    assert table(day / "day.csv")[1:] == [
        ["1", "peg", "1", "learn", "robot", "peg", "done", ""],
        ["2", "peg", "2", "act", "robot", "peg", "failure", "slipped"],
        ["3", "peg", "3", "act", "robot", "peg", "success", ""],
        ["4", "lid", "1", "act", "robot", "peg", "failure", ""],
    ]
    assert (day / "rest.csv").read_text().splitlines()[0].endswith("expected_cost,bay")
    assert [row.split(",")[:3] for row in (day / "changes.csv").read_text().splitlines() if row[0].isdigit()] == [
        ["1", "peg", "done"], ["2", "peg", "failure"], ["3", "peg", "success"], ["4", "lid", "failure"],
    ]  # fmt: skip
    code, told = stage("day", "plan=plan", typed="d\ns\n")
    assert told.out.splitlines()[-2] == "The day is done: 6 outcomes, cost 35.0."
    assert not (day / "rest.csv").exists()
    code, told = stage("day", "plan=plan")
    assert (code, told.out.splitlines()[-2]) == (0, "The day is done: 6 outcomes, cost 35.0.")


def test_a_day_that_is_cut_goes_on_to_the_same_plan(stage, tmp_path):
    stage("day", "plan=plan", "outcomes=outcomes.csv")
    day = tmp_path / "plan" / "day"
    whole, rest = (day / "day.csv").read_bytes(), (day / "rest.csv").read_bytes()
    (tmp_path / "whole.csv").write_bytes(whole)
    (day / "day.csv").write_bytes(whole[:-40])
    code, told = stage("day", "plan=plan", "outcomes=whole.csv")
    assert code == 0, told.err
    assert "its last row was not finished and is left out: 4,lid" in told.out
    assert (day / "day.csv").read_bytes() == whole
    assert (day / "rest.csv").read_bytes() == rest


def test_a_corrected_row_is_a_day_on_which_that_happened(stage, tmp_path):
    stage("day", "plan=plan", "outcomes=outcomes.csv")
    day = tmp_path / "plan" / "day"
    corrected = (day / "day.csv").read_text().replace("peg,2,act,robot,peg,failure", "peg,2,act,robot,peg,success")
    (day / "day.csv").write_text(corrected.rstrip("\n"))  # as some editors leave it
    _, told = stage("day", "plan=plan")
    (tmp_path / "other.csv").write_text(OUTCOMES.replace(",failure,slipped", ",success,slipped"))
    _, other = stage("day", "plan=plan", "outcomes=other.csv", "hydra.run.dir=other")
    assert told.out.splitlines()[-2] == other.out.splitlines()[-2]
    assert (day / "rest.csv").read_text() == (tmp_path / "other" / "rest.csv").read_text()


def test_a_wrong_row_is_told_and_the_day_goes_on_from_the_row_before(stage, tmp_path):
    """In a table of outcomes and in day.csv; there it is set aside when a row takes its place."""
    stage("day", "plan=plan", typed="d\n")
    day = tmp_path / "plan" / "day" / "day.csv"
    good = day.read_text()
    key = good.splitlines()[1].rpartition(",")[2]
    row, problem = "2,peg,2,act,robot,peg,broke,", "row 3, column 'outcome': 'broke' is no outcome; give success, fail"
    (tmp_path / "wrong.csv").write_text(f"{good}{row},{key}\n")
    code, told = stage("day", "plan=plan", "outcomes=wrong.csv")
    assert code == 2
    assert f"wrong.csv, {problem}" in told.err
    assert day.read_text() == good
    tail = f"{row},{key}\n3,peg,3,act,robot,peg,success,mine,{key}\n"
    day.write_text(good + tail)
    code, told = stage("day", "plan=plan")
    assert (code, day.read_text()) == (0, good + tail)  # nothing is touched before something is entered
    assert f"day.csv, {problem}" in told.out
    code, told = stage("day", "plan=plan", typed="s\n")
    assert "2. peg: success" in told.out
    assert day.read_text() == f"{good}2,peg,2,act,robot,peg,success,,{key}\n"
    assert day.with_name("day.refused.csv").read_text() == tail


def test_a_task_that_is_done_and_another_plan_s_day_are_refused(stage, tmp_path):
    (tmp_path / "twice.csv").write_text(OUTCOMES + "peg,success,again\n")
    code, told = stage("day", "plan=plan", "outcomes=twice.csv")
    assert code == 2
    assert "twice.csv, row 6, column 'task': 'peg' is done, all 3 copies; take the row out. No row of the" in told.err
    day = tmp_path / "plan" / "day" / "day.csv"
    assert not day.exists()  # else the corrected table would enter its first rows twice
    assert stage("day", "plan=plan", "outcomes=outcomes.csv")[0] == 0
    assert len(table(day)) == 5
    code, told = stage("day", "plan=plan", "prior_n=9")
    assert (code, "day.csv, row 2, column 'plan': " in told.err) == (2, True)
    kept = day.read_text()
    stage("plan", "tasks=orders.csv", "transfer=transfer.csv", "fill=0.1", "hydra.run.dir=plan")
    code, told = stage("day", "plan=plan")
    assert (code, day.read_text()) == (2, kept)
    assert "is another plan, or one with other settings (prior_n, spread); this one is" in told.err


def test_a_row_that_tells_a_step_otherwise_than_the_day_is_refused(stage, tmp_path):
    """It was skipped without a word."""
    stage("day", "plan=plan", "outcomes=outcomes.csv")
    kept = (tmp_path / "plan/day/day.csv").read_text()
    for row, what in (
        (
            "2,nut,success",
            "row 3, column 'task': 'nut' given, and day.csv has 'peg' in step 2; correct one of them. No",
        ),
        ("2,PEG,success", "row 3, column 'outcome': 'success' given, and day.csv has 'failure' in step 2"),
    ):
        (tmp_path / "more.csv").write_text(f"step,task,outcome\n1,,done\n{row}\n5,,success\n")
        code, told = stage("day", "plan=plan", "outcomes=more.csv")
        assert (code, what in told.err) == (2, True), told.err
        assert (tmp_path / "plan/day/day.csv").read_text() == kept


def test_what_a_day_is_not_of_is_one_message(stage, tmp_path):
    (tmp_path / "then.csv").write_text("scenario,task,count\n1,peg,1\n")
    tables = ("tasks=orders.csv", "transfer=transfer.csv", "fill=0", "scenarios=then.csv", "hydra.run.dir=both")
    assert stage("plan", *tables)[0] == 0
    code, told = stage("day", "plan=both")
    assert (code, "plan=both: is for today and tomorrow, and a day is of today alone; plan the" in told.err) == (
        2,
        True,
    )
    code, told = stage("day")
    assert code == 2
    assert told.err.startswith("stage day: configuration: Missing mandatory value: plan (key 'plan')\n")


def test_at_the_terminal(stage, tmp_path):
    typed = '?\nx\nd\npeg,2,delegate,,,done,"Bo, by hand"\nnot\n"peg,2,delegate,,,done\nq\n'
    code, told = stage("day", "plan=plan", typed=typed)
    assert code == 0, told.err
    assert "1. peg (copy 1 of 3): taught to robot. done / not taught?" in told.out
    assert "'x' is no outcome; give done, not taught. Nothing is entered" in told.out
    assert "2. peg (copy 2 of 3): robot by the lesson on peg, succeeds with 90%. success / failure?" in told.out
    assert 'done,"Bo, by hand",' in (tmp_path / "plan" / "day" / "day.csv").read_text()
    assert told.out.count("Nothing is entered") == 3


def test_a_folder_without_a_day_in_it(stage, tmp_path):
    day = tmp_path / "plan" / "day" / "day.csv"
    day.parent.mkdir()
    day.write_text("task,cost\n1,2\n")
    code, told = stage("day", "plan=plan")
    assert (code, "day.csv, row 1, column 'step'" in told.err) == (2, True)
    (tmp_path / "plan" / "shop.npz").unlink()
    code, told = stage("day", "plan=plan")
    assert (code, "shop.npz: no such file; plan again with" in told.err) == (2, True)
    assert day.read_text() == "task,cost\n1,2\n"


def test_a_day_that_is_killed_goes_on(stage, tmp_path):
    command = [sys.executable, "-m", "stages.day", f"plan={tmp_path / 'plan'}", "tracking=disabled"]
    environment = {**os.environ, "PYTHONPATH": f"{ROOT / 'src'}{os.pathsep}{ROOT}", "PYTHONUNBUFFERED": "1"}
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    with subprocess.Popen(command, cwd=ROOT, env=environment, **pipes) as walk:
        walk.stdin.write("d\nf\n")
        walk.stdin.flush()
        while "3. peg (copy 3 of 3)" not in (line := walk.stdout.readline()):
            assert line or walk.poll() is None
            if "2. peg: failure" in line:
                break
        walk.send_signal(signal.SIGKILL)
    code, told = stage("day", "plan=plan", typed="s\nf\n")
    assert code == 0, told.err
    day = tmp_path / "plan" / "day"
    _, other = stage("day", "plan=plan", "outcomes=outcomes.csv", "hydra.run.dir=other")
    assert (day / "rest.csv").read_text() == (tmp_path / "other" / "rest.csv").read_text()
    assert told.out.splitlines()[-2] == other.out.splitlines()[-2]


def test_a_day_that_is_stopped_goes_on_although_it_has_written_over_its_own_files(stage, tmp_path, monkeypatch):
    """Nothing in the folder was new, so the stop was told as "nothing is kept" and the folder as somebody else's."""
    stage("day", "plan=plan", typed="d\n")

    def stopped(self):
        ask(self)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        ask = importlib.import_module("stages._day").Walk.ask
        patch.setattr("stages._day.Walk.ask", stopped)
        code, told = stage("day", "plan=plan", typed="f\n")
    assert code == 130
    assert "What is finished is kept in plan/day. To go on from there:" in told.err
    code, told = stage("day", "plan=plan", typed="s\n")
    assert code == 0, told.err
    assert told.out.startswith("2 outcomes are in ")
    assert "3. peg: success" in told.out
    (tmp_path / "wrong.csv").write_text("task,outcome\nlid,failure\nplate,success\n")
    assert stage("day", "plan=plan", "outcomes=wrong.csv")[0] == 2
    assert stage("day", "plan=plan", typed="")[0] == 0


def test_what_is_remembered_changes_nothing_but_the_time_it_takes(stage, tmp_path):
    """Every plan of the day was made again at each start."""
    stage("day", "plan=plan", "outcomes=outcomes.csv")
    day = tmp_path / "plan" / "day"
    memory = day / ".progress.jsonl"
    kept = {name: (day / name).read_bytes() for name in ("day.csv", "rest.csv", "changes.csv", ".progress.jsonl")}
    assert kept[".progress.jsonl"].count(b"\n") == 4
    for content in (kept[".progress.jsonl"], kept[".progress.jsonl"][:-30], b"", None):
        memory.unlink()
        if content is not None:
            memory.write_bytes(content)
        code, told = stage("day", "plan=plan")
        assert code == 0, told.err
        assert "4 outcomes are in " in told.out
        assert {name: (day / name).read_bytes() for name in kept} == kept
    lines = kept[".progress.jsonl"].splitlines(keepends=True)
    corrected = kept["day.csv"].replace(b"lid,1,act,robot,peg,failure", b"lid,1,act,robot,peg,success")
    (day / "day.csv").write_bytes(corrected)
    code, told = stage("day", "plan=plan")
    assert code == 0, told.err
    assert memory.read_bytes().splitlines(keepends=True)[:3] == lines[:3]
    assert memory.read_bytes().splitlines(keepends=True)[3] != lines[3]


def test_a_day_is_one_run_of_the_store_however_often_it_is_stopped(stage, tmp_path):
    """Typed, then from a table, then a wrong row, then nothing new: each start was a run from step 0."""
    store = f"tracking.uri=sqlite:///{tmp_path / 'runs.db'}"
    stage("day", "plan=plan", store, typed="d\nf\nq\n")
    (tmp_path / "rest.csv").write_text("step,task,outcome\n3,,success\n4,lid,failure\n")
    code, told = stage("day", "plan=plan", store, "outcomes=rest.csv")
    assert code == 0, told.err
    (tmp_path / "rest.csv").write_text("step,task,outcome\n5,,broke\n")
    assert stage("day", "plan=plan", store, "outcomes=rest.csv")[0] == 2
    stage("day", "plan=plan", store)
    client = MlflowClient(tracking_uri=store.partition("=")[2])
    [run] = client.search_runs([client.get_experiment_by_name("day").experiment_id])
    assert run.info.status == "FINISHED"
    spent = client.get_metric_history(run.info.run_id, "spent")
    assert [each.step for each in spent] == [0, 1, 2, 3, 4]
    assert [each.value for each in spent] == [0.0, 8.0, 18.0, 19.0, 29.0]
    (tmp_path / "plan/day/day.csv").unlink()  # another day
    stage("day", "plan=plan", store, typed="d\nq\n")
    assert len(client.search_runs([client.get_experiment_by_name("day").experiment_id])) == 2
