"""The pipeline as a person runs it: `dvc repro` makes everything once, and again only what changed."""

import json
import os
import signal
import subprocess
import time

import pytest
import yaml
from mlflow import MlflowClient

from tests.pipeline.conftest import Clone, environment

STAGES = {
    "domains": ("collect", "fit_transfer", "plan", "evaluate_team"),
    "worlds": ("discover",),
    "cluster_worlds": ("cluster",),
    "recovery_worlds": ("cluster_lost", "fit_preconditions", "learn_recoveries", "evaluate_recoveries"),
    "chain_worlds": ("chain_recoveries", "evaluate_chains"),
}


def changed(clone):
    """Names of the stages that `dvc repro` would run."""
    return set(json.loads(clone.run("dvc", "status", "--json").stdout))


def is_clean(clone):
    return not changed(clone) and clone.run("git", "status", "--porcelain").stdout == ""


@pytest.fixture
def restored(clone):
    """The clone, put back afterwards: from DVC's cache, without computing."""
    yield clone
    clone.run("git", "checkout", "--quiet", "--", ".")
    clone.run("dvc", "checkout", "--quiet", "--force")
    assert is_clean(clone)


def test_every_output_is_there_and_the_store_has_every_run(clone):
    lock = yaml.safe_load((clone.path / "dvc.lock").read_text())["stages"]
    pipeline = yaml.safe_load((clone.path / "conf/pipeline.yaml").read_text())
    client = MlflowClient(tracking_uri=f"sqlite:///{clone.path / 'mlflow.db'}")
    for stage, items in ((stage, pipeline[kind]) for kind, stages in STAGES.items() for stage in stages):
        assert {f"{stage}@{item}" for item in items} <= set(lock)
        runs = client.search_runs([client.get_experiment_by_name(stage.removesuffix("_lost")).experiment_id])
        assert {run.data.tags["world"] for run in runs} >= set(items)
        assert {run.info.status for run in runs} == {"FINISHED"}
        assert all(run.data.metrics for run in runs)
    for stage in lock.values():
        assert all((clone.path / out["path"]).exists() for out in stage["outs"])


def test_a_second_run_does_nothing(clone):
    lock = (clone.path / "dvc.lock").read_text()
    done = clone.run("dvc", "repro")
    assert "Running stage" not in done.stdout
    assert (clone.path / "dvc.lock").read_text() == lock
    assert is_clean(clone)


def test_what_is_pushed_and_pulled_is_up_to_date_elsewhere(clone, tmp_path):
    """The report hashed the folders of training runs, which no clone has, and was stale after each pull."""
    clone.run("dvc", "remote", "add", "--default", "--local", "beside", str(tmp_path / "remote"))
    clone.run("dvc", "push")
    other = Clone(tmp_path / "other")
    clone.run("git", "clone", "--quiet", str(clone.path), str(other.path))
    other.run("dvc", "remote", "add", "--default", "--local", "beside", str(tmp_path / "remote"))
    other.run("dvc", "pull")
    assert other.run("dvc", "status").stdout.strip() == "Data and pipelines are up to date."


def test_hand_runs_and_sweeps_leave_dvc_and_git_alone(clone):
    small = ("domain=lego", "experiment=smoke", "tracking=disabled")
    clone.run("python", "-m", "stages.collect", *small, "seed=5")
    sweep = ("-m", "seed=0,1,2", "hydra/launcher=parallel")
    clone.run("python", "-m", "stages.collect", *small, *sweep)
    assert len(list(clone.path.glob("multirun/collect/*/*/transfer_data.npz"))) == 3
    assert is_clean(clone)


def test_a_comment_reruns_only_the_composition(restored):
    restored.edit("conf/domain/lego.yaml", r"\A", "# A remark.\n")
    assert changed(restored) == {"config"}
    restored.run("dvc", "repro", "config")
    assert changed(restored) == set()


def test_one_domains_configuration_reruns_only_that_domain(restored):
    restored.edit("conf/domain/lego.yaml", r"^params: \{\}|^params:$", r"params: {max_taps: 7}")
    restored.run("dvc", "repro", "config")
    assert "collect@lego" in changed(restored)
    assert {name for name in changed(restored) if not name.endswith("@lego")} <= {"report"}


def test_a_bad_configuration_stops_before_compute_and_deletes_nothing(restored):
    restored.edit("conf/experiment/smoke.yaml", r"^fit_transfer: .*", "fit_transfer: {epochs: 0}")
    done = restored.run("dvc", "repro", check=False)
    assert done.returncode != 0
    assert "epochs: given '0'" in done.stderr
    assert restored.run("git", "status", "--porcelain").stdout.split() == ["M", "conf/experiment/smoke.yaml"]


def test_a_killed_stage_is_completed_by_the_next_run(restored):
    restored.edit("conf/pipeline.yaml", r"^overrides: .*", 'overrides: {collect: ["draws=60"]}')
    restored.run("dvc", "repro", "config")
    folder = restored.path / "data/collect/lego"
    (folder / "run.json").unlink()
    process = subprocess.Popen(
        ["dvc", "repro", "collect@lego"], cwd=restored.path, env=environment(), start_new_session=True,
        stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    while not (folder / "run.json").exists():  # the stage has begun its work
        assert process.poll() is None
        time.sleep(0.01)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert not (folder / "transfer_data.npz").exists()
    killed = json.loads((folder / "run.json").read_text())["run_id"]
    restored.run("dvc", "repro", "collect@lego")
    assert (folder / "transfer_data.npz").exists()
    assert json.loads((folder / "run.json").read_text())["run_id"] == killed
    client = MlflowClient(tracking_uri=f"sqlite:///{restored.path / 'mlflow.db'}")
    assert client.get_run(killed).info.status == "FINISHED"
