"""The command line of every stage: one message and exit code 2 for a mistake, nothing left behind, lean imports."""

import importlib
import os
import signal
import subprocess
import sys
import time
from pathlib import Path, PurePath

import pytest
from hydra import compose, initialize_config_dir
from hydra.core.override_parser.overrides_parser import OverridesParser
from mlflow import MlflowClient

from p2l.schema import SCHEMAS, paths_of
from stages import collect
from stages._place import WRITES
from stages._stage import _arguments
from tests import waiting

ROOT = Path(__file__).resolve().parents[2]
STAGES = sorted(path.stem for path in (ROOT / "stages").glob("[a-z]*.py"))
PATHS = frozenset({"hydra.run.dir"}).union(*map(paths_of, SCHEMAS.values()))
SMALL = ("domain=lego", "experiment=smoke")


def run(*words, store="sqlite:////nowhere/runs.db", **environment):
    """Run `python -m stages.<words>` in the repository."""
    known = {**os.environ, "MLFLOW_TRACKING_URI": store, **environment}
    command = [sys.executable, "-m", f"stages.{words[0]}", *words[1:]]
    return waiting.run(command, cwd=ROOT, env=known)


@pytest.mark.parametrize("name", STAGES)
def test_help_says_what_the_stage_does_and_how_to_call_it(name, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    with pytest.raises(SystemExit) as left:
        importlib.import_module(f"stages.{name}").run()
    shown = capsys.readouterr().out
    assert left.value.code == 0
    for part in (f"{name}: ", f"python -m stages.{name}", "hydra/launcher=joblib"):
        assert part in shown
    assert ("seed: 0" in shown) == (name not in ("ask", "plan"))  # whose help fits a screen, without all settings


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("seed=-3", "draws=0"), ("seed: given '-3'", "draws: given '0'")),
        (("draws=.nan",), ("draws: given", "valid integer")),
        (("n_taught=40", "n_tasks=30"), ("n_taught = 40 exceeds n_tasks = 30",)),
        (("drawss=4",), ("drawss", "--help")),
        (("+drawss=4",), ("drawss: unknown key", "did you mean 'draws'")),
        (("domain=door",), ("domain/door", "insertion")),
        (("domain.name=door", "n_tasks=9", "n_taught=9", "draws=9"), ("domain.name: given 'door'", "lego")),
        (("domain.name=door",), ("experiment.door.n_tasks",)),
        (("domain.params.taps=3", "-m"), ("taps",)),
        (("+domain.params.taps=3",), ("taps", "max_taps")),
        (("seed=[1",), ("[1",)),
        (("-cp", "data/nowhere"), ("data/nowhere",)),
        (("--sideways",), ("--sideways",)),
        ((), ("no such folder /nowhere", "tracking.enabled=false")),
    ],
)
def test_a_mistake_is_one_message_and_leaves_nothing(tmp_path, monkeypatch, capsys, words, parts):
    out = tmp_path / "out"
    tracking = () if not words else ("tracking=disabled",)
    places = (f"hydra.run.dir={out}", f"hydra.sweep.dir={tmp_path / 'sweep'}")
    monkeypatch.setattr(sys, "argv", ["collect", *SMALL, *tracking, *places, *words])
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    monkeypatch.setenv("MLFLOW_TRACKING_URI", "sqlite:////nowhere/runs.db")
    with pytest.raises(SystemExit) as left:
        collect.run()
    message = capsys.readouterr().err
    assert left.value.code == 2
    assert "Traceback" not in message
    for part in parts:
        assert part in message
    assert not out.exists()


def test_a_refused_rerun_leaves_the_earlier_run_as_it_was(tmp_path, monkeypatch):
    out = tmp_path / "out"
    out.mkdir()
    for name in ("run.json", "config.yaml", "transfer_data.npz"):
        (out / name).write_text("earlier")
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    monkeypatch.setattr(sys, "argv", ["collect", *SMALL, "tracking=disabled", f"hydra.run.dir={out}", "draws=0"])
    with pytest.raises(SystemExit):
        collect.run()
    assert {path.name: path.read_text() for path in out.iterdir()} == dict.fromkeys(
        ("run.json", "config.yaml", "transfer_data.npz"), "earlier"
    )


@pytest.mark.parametrize("kept", ["", "runs", "runs/mistyped/day"])
@pytest.mark.parametrize("name", ["day", "check_plan", "collect"])
def test_a_refused_run_leaves_none_of_the_folders_that_were_made_for_it(tmp_path, monkeypatch, capsys, name, kept):
    """`day plan=mistyped` left an empty folder `mistyped`."""
    (tmp_path / kept).mkdir(parents=True, exist_ok=True)
    before = sorted(tmp_path.rglob("*"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    words = {
        "day": ("plan=runs/mistyped",),
        "check_plan": ("plan=runs/mistyped", "tasks=a.csv", "transfer=b.csv", "hydra.run.dir=runs/mistyped/day"),
        "collect": (*SMALL, "draws=0", "hydra.run.dir=runs/mistyped/day"),
    }[name]
    monkeypatch.setattr(sys, "argv", [name, *words, "tracking=disabled"])
    with pytest.raises(SystemExit) as left:
        importlib.import_module(f"stages.{name}").run()
    told = capsys.readouterr().err
    assert (left.value.code, "Traceback" in told, "Warning" in told) == (2, False, False)
    after = [path for path in sorted(tmp_path.rglob("*")) if path != tmp_path / "runs/mistyped/day"]
    assert after == [path for path in before if path != tmp_path / "runs/mistyped/day"]


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        ("orders.csv", "orders.csv"),
        ("orders (1).csv", "orders (1).csv"),
        ("a, b=[c] {d} #e*.csv", "a, b=[c] {d} #e*.csv"),
        ("it's.csv", "it's.csv"),
        ("~/orders.csv", "/people/of a town/orders.csv"),
        ("'orders (1).csv'", "orders (1).csv"),
        (r"orders\ \(1\).csv", "orders (1).csv"),
        ("null", None),
    ],
)
@pytest.mark.parametrize("key", ["tasks", "transfer", "failures", "held_out", "learnt", "plan", "hydra.run.dir"])
def test_a_path_on_the_command_line_may_hold_what_hydra_reads_otherwise(monkeypatch, key, given, meant):
    monkeypatch.setenv("HOME", "/people/of a town")
    word = _arguments([f"{key}={given}"], PATHS)[0]
    assert OverridesParser.create().parse_override(word).value() == meant


def test_only_paths_of_a_single_run_are_quoted():
    assert _arguments(["-m", "tasks=a.csv,b.csv"], PATHS)[1] == "tasks=a.csv,b.csv"
    assert _arguments(["study.levels=[0, 1]"], PATHS)[0] == "study.levels=[0, 1]"


def test_a_bug_keeps_its_traceback_and_is_not_taken_for_bad_input(tmp_path):
    """Exit code 1 tells a bug from a mistake of the user's."""
    (tmp_path / "broken.py").write_text(
        "from p2l.schema import CollectConfig\nfrom stages._stage import stage\n\n\n"
        "@stage('collect', CollectConfig)\ndef run(cfg, out, track):\n    raise RuntimeError('bug')\n\n\nrun()\n"
    )
    command = [
        sys.executable,
        str(tmp_path / "broken.py"),
        *SMALL,
        "tracking=disabled",
        f"hydra.run.dir={tmp_path / 'o'}",
    ]
    known = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{ROOT / 'src'}"}
    done = waiting.run(command, cwd=tmp_path, env=known)
    assert done.returncode == 1
    assert "RuntimeError: bug" in done.stderr


@pytest.mark.parametrize("launcher", ["basic", "joblib"])
def test_a_failing_job_of_a_sweep_leaves_its_siblings_alone(tmp_path, launcher):
    store = f"sqlite:///{tmp_path / 'runs.db'}"
    words = (*SMALL, "-m", "n_taught=99,5,6", f"hydra/launcher={launcher}", f"hydra.sweep.dir={tmp_path / 'sweep'}")
    done = run("collect", *words, store=store)
    assert done.returncode == 2, done.stderr
    assert "n_taught=99" in done.stderr
    assert "Traceback" not in done.stderr
    made = sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.glob("sweep/*/transfer_data.npz"))
    assert made == ["sweep/1/transfer_data.npz", "sweep/2/transfer_data.npz"]
    assert not (tmp_path / "sweep" / "0").exists()
    client = MlflowClient(tracking_uri=store)
    runs = client.search_runs([each.experiment_id for each in client.search_experiments() if each.name == "collect"])
    [parent] = [each for each in runs if each.data.tags.get("kind") == "sweep"]
    children = [each for each in runs if each is not parent]
    assert {each.data.tags["mlflow.parentRunId"] for each in children} == {parent.info.run_id}
    assert {each.data.params["n_taught"] for each in children} == {"5", "6"}
    assert (parent.info.status, {each.info.status for each in children}) == ("FAILED", {"FINISHED"})


def test_a_run_says_how_to_repeat_it_and_repeats(tmp_path):
    store, out = f"sqlite:///{tmp_path / 'runs.db'}", tmp_path / "out"
    first = run("collect", *SMALL, "seed=3", "draws=3", f"hydra.run.dir={out}", store=store)
    assert first.returncode == 0, first.stderr
    made = (out / "transfer_data.npz").read_bytes()
    client = MlflowClient(tracking_uri=store)
    [done] = client.search_runs([client.get_experiment_by_name("collect").experiment_id])
    python, *words = done.data.tags["command"].split()
    (out / "transfer_data.npz").unlink()
    again = [sys.executable, *words]
    waiting.run(again, cwd=ROOT, env={**os.environ, "MLFLOW_TRACKING_URI": store}, check=True)
    assert python == "python"
    assert (out / "transfer_data.npz").read_bytes() == made


HEAVY = {
    "torch",
    "mujoco",
    "robosuite",
    "stable_baselines3",
    "sklearn",
    "pyomo",
    "highspy",
    "mlflow",
    "matplotlib",
    "numba",
}
NEEDS = {
    "chain_recoveries": {"mujoco", "torch", "stable_baselines3"},
    "cluster": {"mujoco", "matplotlib", "sklearn"},
    "collect": {"mujoco", "matplotlib"},
    "discover": {"mujoco"},
    "watch": {"mujoco"},
    "config": set(),
    "day": set(),
    "fit_preconditions": {"mujoco", "matplotlib"},
    "fit_transfer": {"torch", "matplotlib"},
    "iterate_recoveries": {"mujoco", "matplotlib", "sklearn"},
    "learn_recoveries": {"mujoco", "matplotlib"},
    "ask": set(),
    "check_plan": set(),
    "export": {"mujoco", "torch"},
    "plan": set(),
    "predict_transfer": set(),
    "evaluate_chains": {"mujoco", "torch", "matplotlib"},
    "evaluate_recoveries": {"mujoco", "matplotlib"},
    "evaluate_team": {"mujoco"},
    "report": {"matplotlib", "mujoco"},  # the environments are drawn from the worlds themselves
}


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_imports_only_what_it_needs(name):
    code = f"import sys, stages.{name}; print(*sys.modules)"
    done = waiting.run([sys.executable, "-c", code], cwd=ROOT)
    assert done.returncode == 0, done.stderr
    assert HEAVY & set(done.stdout.split()) <= NEEDS[name]


def test_a_plan_that_cannot_be_drawn_leaves_no_half_output(tmp_path, monkeypatch, capsys):
    (tmp_path / "o (1).csv").write_text("task,c_rob,c_hum,c_fail,c_demo\ncup,10,100,100,200\n")
    (tmp_path / "t.csv").write_text(",cup\ncup,1\n")
    out = tmp_path / "out"
    files = (f"tasks={tmp_path / 'o (1).csv'}", f"transfer={tmp_path / 't.csv'}")
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    monkeypatch.setattr(sys, "argv", ["plan", *files, "tracking=disabled", f"hydra.run.dir={out}"])

    def fail(*_):
        raise RuntimeError("no font")

    monkeypatch.setattr("p2l.evaluation.team.shop_figure.save_shop_figure", fail)
    with pytest.raises(SystemExit) as left:
        importlib.import_module("stages.plan").run()
    assert (left.value.code, "RuntimeError: no font" in capsys.readouterr().err) == (1, True)
    assert not list(out.glob("plan.*"))


@pytest.mark.parametrize(("number", "code", "by"), [(signal.SIGINT, 130, "Ctrl-C"), (signal.SIGTERM, 143, "SIGTERM")])
def test_a_stop_is_two_lines_that_say_how_to_go_on_and_a_killed_run(number, code, by, tmp_path):
    """Ctrl-C was 40 to 70 lines of traceback; SIGTERM said nothing and left the run RUNNING for ever."""
    store = f"sqlite:///{tmp_path}/runs.db"
    words = ["world=pick_place", "executions.train=100000", f"hydra.run.dir={tmp_path}/out", f"tracking.uri={store}"]
    command = [sys.executable, "-m", "stages.discover", *words]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while not (tmp_path / "out/run.json").exists():
            assert process.poll() is None, process.stderr.read()
            time.sleep(0.1)
        process.send_signal(number)
        _, told = process.communicate()
    assert process.returncode == code, told
    assert "Traceback" not in told
    assert f"stage discover: stopped by {by}. Nothing is kept. To begin again:\n  python -m stages.discover" in told
    [run] = MlflowClient(store).search_runs(["1"])
    assert run.info.status == "KILLED"
    assert not (tmp_path / "out").exists()


def test_of_two_runs_at_once_in_a_folder_the_second_is_refused(tmp_path):
    """Both wrote checkpoints and tables there, each over the other's. A run that was killed is in nobody's way."""
    out, words = tmp_path / "out", ["experiment=smoke", "world=pick_place", "tracking.enabled=false"]
    words.append(f"hydra.run.dir={out}")
    first = subprocess.Popen([sys.executable, "-m", "stages.discover", *words, "executions.train=100000"], cwd=ROOT)
    while not (out / ".unfinished.json").exists():
        assert first.poll() is None
        time.sleep(0.1)
    before = {file.name: file.read_bytes() for file in out.iterdir()}
    second = run("discover", *words)
    assert (second.returncode, second.stdout) == (2, "")
    assert second.stderr.startswith(f"stage discover: {out}: another run is at work in this folder; wait until")
    assert {file.name: file.read_bytes() for file in out.iterdir()} == before
    first.kill()
    first.wait()
    assert run("discover", *words).returncode == 0


def test_a_stopped_sweep_says_how_to_run_it_again_and_leaves_nothing_running(tmp_path):
    """The parent was FAILED and its jobs stayed RUNNING; later it said nothing of a command."""
    store = f"sqlite:///{tmp_path}/runs.db"
    words = ["-m", "hydra/launcher=joblib", "seed=0,1", "world=pick_place", "executions.train=100000"]
    words += [f"hydra.sweep.dir={tmp_path}/sweep", f"tracking.uri={store}"]
    command = [sys.executable, "-m", "stages.discover", *words]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        while len(list(tmp_path.glob("sweep/*/run.json"))) < 2:
            assert process.poll() is None, process.stderr.read()
            time.sleep(0.1)
        process.terminate()
        _, told = process.communicate()
    assert process.returncode == 143, told
    assert "Traceback" not in told
    assert f"stopped by SIGTERM. To run it again:\n  python -m stages.discover {' '.join(words)}" in told
    assert [run.info.status for run in MlflowClient(store).search_runs(["1"])] == ["KILLED"] * 3


def test_a_password_in_the_store_s_uri_is_written_nowhere(tmp_path):
    """It stood in config.yaml, params, tags, notes and artifacts. (sqlite ignores what its URI says before an @.)"""
    words = ["domain=lego", "experiment=smoke", f"hydra.run.dir={tmp_path}/out"]
    uri = f"sqlite:///{tmp_path}/runs.db?name=http://me:Tr0ub4dor@host"
    done = run("collect", *words, f"tracking.uri='{uri}'")
    assert done.returncode == 0, done.stderr
    assert "Tr0ub4dor" not in done.stdout + done.stderr
    for file in tmp_path.rglob("*"):
        assert not file.is_file() or b"Tr0ub4dor" not in file.read_bytes(), file
    [run_] = MlflowClient(f"sqlite:///{tmp_path}/runs.db").search_runs(["1"])
    assert not [name for name in run_.data.params if name.startswith("tracking")]


def test_an_ascii_terminal_is_no_reason_to_fail(tmp_path):
    (tmp_path / "o.csv").write_text("task,c_rob,c_hum,c_fail,c_demo\nGröße,10,100,100,200\n", encoding="utf-8")
    (tmp_path / "t.csv").write_text("task,Größe\nGröße,1\n", encoding="utf-8")
    words = (f"tasks={tmp_path}/o.csv", f"transfer={tmp_path}/t.csv", f"hydra.run.dir={tmp_path}/out")
    done = run("plan", *words, "tracking=disabled", PYTHONIOENCODING="ascii", PYTHONUTF8="0", LC_ALL="C")
    assert done.returncode == 0, done.stderr
    assert "Größe" in (tmp_path / "out/plan.csv").read_text(encoding="utf-8")


def test_a_stage_that_goes_on_has_a_folder_of_its_configuration():
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        folders = [
            compose("chain_recoveries", words, return_hydra_config=True).hydra.run.dir
            for words in ([], ["tracking=disabled"], ["seed=1"], ["world=shelf"])
        ]
    assert folders[0] == folders[1]
    assert len(set(folders)) == 3
    assert folders[0].startswith("outputs/app/pick_place-")  # compose knows no stage


ORDERS = "task,c_rob,c_hum,c_fail,c_demo,pretrained\na,10,100,100,200,0.95\n"
TRANSFER = "task,a\na,0.95\n"


def shell(line, folder):
    """Run a line of bash in `folder`, where two tasks lie."""
    (folder / "orders.csv").write_text(ORDERS)
    (folder / "transfer.csv").write_text(TRANSFER)
    known = {**os.environ, "PYTHONPATH": str(ROOT), "PYTHON": sys.executable}
    return waiting.run(["bash", "-c", f"set -o pipefail\n{line}"], cwd=folder, env=known)


def test_a_reader_who_leaves_does_not_fail_the_work(tmp_path):
    """The run was FAILED, with a traceback, after its files were written."""
    plan = "$PYTHON -m stages.plan tasks=orders.csv transfer=transfer.csv tracking.enabled=false hydra.run.dir=out"
    done = shell(f"{plan} | true", tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "out" / "manifest.json").is_file()  # the last thing that a stage writes
    helped = shell("$PYTHON -m stages.plan --help | head -1", tmp_path)
    assert (helped.returncode, helped.stderr) == (0, "")
    assert helped.stdout.startswith("plan: ")


def test_tasks_may_come_through_a_pipe(tmp_path):
    """`tasks=<(…)` was no such file."""
    pipes = "tasks=<(cat orders.csv) transfer=<(cat transfer.csv)"
    done = shell(f"$PYTHON -m stages.plan {pipes} tracking.enabled=false hydra.run.dir=out", tmp_path)
    assert done.returncode == 0, done.stderr
    assert "proven optimal" in done.stdout


def here(stage, folder, monkeypatch, capsys, *words):
    """Run a stage of this process that writes to `folder`; its exit code and what it said on standard error."""
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    monkeypatch.setattr(sys, "argv", [stage, *words, "tracking=disabled", f"hydra.run.dir={folder}"])
    capsys.readouterr()
    with pytest.raises(SystemExit) as left:
        importlib.import_module(f"stages.{stage}").run()
    return left.value.code, capsys.readouterr().err


@pytest.mark.parametrize(
    ("stage", "words", "mine"),
    [
        ("plan", (), ("config.yaml", "plan.csv", "reasons.csv", "plan.html", "plan.json", "certificate.npz")),
        ("collect", SMALL, ("config.yaml", "run.json", "transfer_data.npz", "strategy.png", "summary.json")),
        ("discover", ("world=pick_place",), ("config.yaml", "failures_train.npz", "summary.json")),
        ("predict_transfer", ("features=features.csv",), ("config.yaml", "transfer.csv", "next_trials.csv")),
        ("report", (), ("config.yaml", "index.html", "tables/costs.csv")),
        ("config", (), ("config.yaml", "photos/me.png", "photos/old/me.yaml")),
    ],
)
def test_a_persons_own_file_is_not_overwritten(stage, words, mine, tmp_path, monkeypatch, capsys):
    """Every stage wrote its config.yaml over a person's, and `stages.config hydra.run.dir=.` deleted their folders."""
    (tmp_path / "orders.csv").write_text(ORDERS)  # what no stage writes is in nobody's way
    (tmp_path / "lessons.csv").write_text(TRANSFER)
    files = (f"tasks={tmp_path / 'orders.csv'}", f"transfer={tmp_path / 'lessons.csv'}") if stage == "plan" else words
    for name in mine:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("seed: 1\n")
        before = {path: path.is_dir() or path.read_bytes() for path in tmp_path.rglob("*")}
        code, told = here(stage, tmp_path, monkeypatch, capsys, *files)
        assert code == 2, told
        assert f"{tmp_path / name}: would be overwritten, and is not as a stage wrote it" in told
        assert {path: path.is_dir() or path.read_bytes() for path in tmp_path.rglob("*")} == before
        (tmp_path / name).unlink()


def test_a_stage_writes_over_its_own_files_unless_somebody_has_edited_them(tmp_path, monkeypatch, capsys):
    """Finished or stopped, the next run goes on in its folder."""
    (tmp_path / "orders.csv").write_text(ORDERS)
    (tmp_path / "lessons.csv").write_text(TRANSFER)
    words = (f"tasks={tmp_path / 'orders.csv'}", f"transfer={tmp_path / 'lessons.csv'}")
    out = tmp_path / "out"
    with monkeypatch.context() as broken:
        broken.setattr("stages._shop.write_shop_plan", lambda *_, **__: 1 / 0)
        assert here("plan", out, monkeypatch, capsys, *words)[0] == 1
    assert {file.name for file in out.iterdir()} == {"plan.png", "plan.html", "shop.npz", ".unfinished.json"}
    for _ in range(2):
        code, told = here("plan", out, monkeypatch, capsys, *words)
        assert code == 0, told
        assert not (out / ".unfinished.json").exists()
    code, told = here("plan", out, monkeypatch, capsys, f"tasks={out / 'plan.csv'}", words[1])
    assert (code, "plan.csv: is an input, and the plan would overwrite it" in told) == (2, True)
    assert not (out / ".unfinished.json").exists()
    (out / "plan.csv").write_text("my notes\n")
    code, told = here("plan", out, monkeypatch, capsys, *words)
    assert (code, "plan.csv: would be overwritten" in told) == (2, True)
    assert (out / "plan.csv").read_text() == "my notes\n"


def test_every_output_in_the_pipeline_is_guarded():
    """Each path that dvc.yaml tracks is one that its stage is known to write."""
    tracked = [line.strip(" -\n") for line in (ROOT / "dvc.yaml").read_text().splitlines() if "- data/" in line]
    for path in {each.partition(" ")[0].rstrip(":") for each in tracked}:
        _, stage, *rest = path.split("/")
        name = "/".join(rest if stage == "report" else rest[1:])
        if name in ("", "manifest.json") or stage in ("config", "thesis"):
            continue
        assert any(PurePath(name).match(each) or each.startswith(f"{name}/") for each in WRITES[stage]), path
    assert sorted(WRITES) == STAGES


def test_ctrl_c_while_a_stage_is_imported_is_one_line(tmp_path):
    """It was Python's traceback of an import."""
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal, sys\n\n\nclass Impatient:\n    def find_spec(self, name, *_):\n"
        "        if name == 'hydra':\n            os.kill(os.getpid(), signal.SIGINT)\n\n\n"
        "sys.meta_path.insert(0, Impatient())\n"
    )
    done = run("plan", "--help", PYTHONPATH=str(tmp_path))
    assert (done.returncode, done.stdout, done.stderr) == (130, "", "stopped by Ctrl-C before anything was begun\n")


@pytest.mark.parametrize("place", ["/proc/nowhere", "taken"])
def test_a_place_that_cannot_be_written_is_one_message(tmp_path, place):
    """Hydra's own traceback, and exit code 1."""
    (tmp_path / "taken").write_text("a file")
    done = shell(f"$PYTHON -m stages.collect domain=lego tracking.enabled=false hydra.run.dir={place}", tmp_path)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    assert place in done.stderr
