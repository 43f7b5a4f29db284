"""Ten random kills and ten resumes of every stage that keeps checkpoints, records or files for other machines.

`pytest -m slow tests/stages/test_kills.py`; with `-k threads` only that one thread or two, and another hash seed, leave
the same bytes. Each stage runs once undisturbed, then in another folder, where SIGKILL
takes it down ten times at random moments, the middle of an import or of a write among them; what it has left in the
end is the same, byte by byte.
"""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tests import waiting

ROOT = Path(__file__).resolve().parents[2]
KILLS = 10
SMOKE = "experiment=smoke"
WORKING = {"run.json", "stage.log", "times.json", "config.yaml", "parent.json"}  # not functions of the inputs
FOLDERS = {"records", "runs", "checkpoints"}  # hold wall times, or what a run goes on from; so do ledgers

pytestmark = pytest.mark.slow


def command(stage, out, records, *words):
    """The command of a stage in `out`; `records` where its finished items lie, as at thesis scale."""
    fixed = ["tracking.enabled=false", f"hydra.run.dir={out}"]
    if stage != "plan":  # it keeps nothing
        fixed.append(f"records={records}")
    return [sys.executable, "-m", f"stages.{stage}", SMOKE, *words, *fixed]


def to_the_end(words, **environment):
    waiting.run(words, cwd=ROOT, env=os.environ | environment, check=True)


def killed(words, after_s):
    """Run a command and kill it and all below it after a while; whether it was still at work."""
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    process = subprocess.Popen(words, cwd=ROOT, start_new_session=True, **quiet)
    try:
        process.wait(timeout=after_s)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        return True
    return False


def outputs(folder):
    """Content by name of everything that is a function of the inputs."""
    files = {file.relative_to(folder): file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    return {
        name: content
        for name, content in files.items()
        if name.name not in WORKING and name.parts[0] not in FOLDERS and not name.name.endswith((".lock", "ledger.npz"))
    }


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Folders of stages that others read, made when they are first asked for."""
    base, ready = tmp_path_factory.mktemp("made"), {}

    def folder(stage, item, *words):
        if (stage, item) not in ready:
            out = base / stage / item
            to_the_end(command(stage, out, "null", *words))
            ready[stage, item] = out
        return ready[stage, item]

    return folder


def failures(folder):
    return f"failures={folder / 'failures_train.npz'}", f"held_out={folder / 'failures_held_out.npz'}"


def of_door(made):
    """What `learn_recoveries` reads."""
    found = failures(made("discover", "door", "world=door"))
    fitted = f"preconditions={made('fit_preconditions', 'door', 'world=door') / 'preconditions.npz'}"
    modes = made("cluster", "door", "world=door", "videos=false", *found, fitted) / "modes.npz"
    return "world=door", *found, fitted, f"modes={modes}"


def of_team(made):
    """What `evaluate_team` reads."""
    data = f"transfer_data={made('collect', 'lego', 'domain=lego') / 'transfer_data.npz'}"
    model = made("fit_transfer", "lego", "domain=lego", data) / "transfer_model.safetensors"
    plans = made("plan", "lego", "domain=lego", data, f"transfer_model={model}") / "plans.parquet"
    return "domain=lego", f"plans={plans}"


STAGES = {
    "discover": lambda _: ("world=door",),
    "fit_preconditions": lambda _: ("world=door",),
    "cluster": lambda made: ("world=door", "videos=false", *failures(made("discover", "door", "world=door"))),
    "collect": lambda _: ("domain=lego",),
    "fit_transfer": lambda made: (
        "domain=lego",
        f"transfer_data={made('collect', 'lego', 'domain=lego') / 'transfer_data.npz'}",
    ),
    "evaluate_team": of_team,
    "learn_recoveries": lambda made: (*of_door(made), "videos=false"),
    "iterate_recoveries": lambda made: (*of_door(made), "failure_rounds=2"),
    "evaluate_recoveries": lambda made: (
        "world=door",
        *(word for word in of_door(made) if word.startswith(("modes=", "preconditions="))),
        f"learnt={made('learn_recoveries', 'door', *of_door(made), 'videos=false')}",
    ),
    "chain_recoveries": lambda made: (
        "world=pick_place",
        "compare=[rc]",
        "seeds=[0]",
        f"failures={made('discover', 'pick_place', 'world=pick_place') / 'failures_train.npz'}",
    ),
    "evaluate_chains": lambda made: (
        "world=pick_place",
        f"learnt={made('chain_recoveries', 'pick_place', *STAGES['chain_recoveries'](made))}",
    ),
}


@pytest.mark.parametrize("stage", STAGES)
def test_ten_kills_and_ten_resumes_leave_what_an_undisturbed_run_leaves(stage, made, tmp_path):
    words = STAGES[stage](made)
    calm, wild = tmp_path / "calm", tmp_path / "wild"
    begin = time.monotonic()
    to_the_end(command(stage, calm, tmp_path / "calm_records", *words))
    whole_s = time.monotonic() - begin
    rng, hits = random.Random(f"kills of {stage}"), 0
    disturbed = command(stage, wild, tmp_path / "wild_records", *words)
    for _ in range(KILLS):
        hits += killed(disturbed, rng.uniform(0.05, 1.0) * whole_s)
    to_the_end(disturbed)
    assert hits, "no kill came while it was at work"
    assert outputs(wild) == outputs(calm)
    left = [path for folder in (wild, tmp_path / "wild_records") for path in folder.rglob(".*") if path.is_file()]
    assert left == [], "what killed processes were writing is gone"


@pytest.mark.parametrize("stage", STAGES)
def test_neither_threads_nor_hash_seeds_change_a_byte(stage, made, tmp_path):
    words = STAGES[stage](made)
    for number in ("1", "2"):
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), number)
        one = command(stage, tmp_path / number, tmp_path / f"records_{number}", *words)
        to_the_end(one, PYTHONHASHSEED=number, **threads)
    assert outputs(tmp_path / "1") == outputs(tmp_path / "2")
