"""The stages chain_recoveries and evaluate_chains, on the small push world: what they write, and what they refuse."""

import json
import os
import re
import shutil
import signal
import sys
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pandas as pd
import pytest
import torch
from hydra import compose, initialize_config_dir
from mlflow import MlflowClient
from omegaconf import OmegaConf

from p2l.artifacts import load_json, load_table
from p2l.chaining import comparison
from p2l.chaining.agent import load_agent
from p2l.chaining.checkpoint import FILE
from p2l.chaining.clips import nominal_clip, recovery_clip
from p2l.chaining.execute import recover
from p2l.chaining.learners.table import LEARNERS
from p2l.chaining.policy import load_policy, policy_hash
from p2l.errors import ArtifactError, ConfigError
from p2l.evaluation.video.player import NoGLError, backend
from p2l.failures.record import load_failures, open_world
from p2l.manifest import write_manifest
from p2l.schema import SCHEMAS, ChainRecoveriesConfig, resolve, validate
from p2l.tracking import RunCard, Tracker, start
from stages import _stage, chain_recoveries, cluster, discover, evaluate_chains, watch
from stages.chain_recoveries import already
from tests import waiting
from tests.failures import pushing

ROOT = Path(__file__).resolve().parents[2]
STAGES = {
    "discover": discover,
    "cluster": cluster,
    "chain_recoveries": chain_recoveries,
    "evaluate_chains": evaluate_chains,
    "watch": watch,
}
PUSH = {"name": "push", "params": {"sigma_m": 0.03, "nthread": 1}}
SMALL = {"n_steps": 24, "batch_size": 12, "n_epochs": 1, "hidden": [8]}
assert pushing.found  # importing it registers the world


TRACKED = {"compare": ["rc"], "seeds": [0], "budget": 1500, "evaluation": {"every": 300, "episodes": 4}}
KILL = """
import os, signal, sys
from pathlib import Path
from p2l.chaining import train
from tests.stages.test_chain_stages import TRACKED, compare, tracked

save, saved = train.save_checkpoint, []
def killed(*given):
    save(*given)
    saved.append(1)
    if len(saved) == {checkpoints}:
        os.kill(os.getpid(), signal.SIGKILL)
train.save_checkpoint = killed
with tracked(Path(sys.argv[2]), sys.argv[3]) as track:
    compare(Path(sys.argv[1]), Path(sys.argv[2]), track=track, tracking=dict(enabled=True, uri=sys.argv[3]), **TRACKED)
"""


def tracked(out, store):
    """A run in a store of its own, as the command line would start it."""
    out.mkdir(parents=True, exist_ok=True)
    card = RunCard("chain_recoveries", "push", "learners", 0, {}, "hash", "python -m stages.chain_recoveries", None)
    return start(card, out, ROOT, uri=store)


def run(name, out, track=None, **changes):
    """Run a stage in this process, on push, with values of its configuration changed."""
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        plain = resolve(compose(name, ["experiment=smoke"]))
    if "ppo" in plain:
        plain["ppo"] |= SMALL
    if "records" in plain:
        plain["records"] = None
    if "limits" in plain:  # the composition is of the default world
        plain |= {"limits": plain["limits"] | {"fields": []}, "limits_of": {}}
    plain |= {"item": "push", "world": PUSH, **changes}
    out.mkdir(parents=True, exist_ok=True)
    STAGES[name].run.__wrapped__(validate(plain, SCHEMAS[name], "test"), out, track or Tracker())
    write_manifest(out)


def learn(found, out, learner="rc", **changes):
    params = {"trajectories": 60, "every": 2} if learner == "pp" else {}
    one = learner if isinstance(learner, dict) else {"name": learner, "params": params}
    settings = {"learner": one, "budget": 600, "slots": 8, **changes}
    run("chain_recoveries", out, failures=str(found / "failures_train.npz"), **settings)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    out = tmp_path_factory.mktemp("discover")
    run("discover", out, strategy="first_flag", executions={"train": 40, "held_out": 4})
    return out


PP = {"trajectories": 60, "every": 2}
COMPARED = {name: {"name": name, "params": PP if name == "pp" else {}} for name in ("rc", "pp")}


def compare(found, out, **changes):
    settings = {"learners": COMPARED, "compare": ["rc", "pp"], "seeds": [0], "budget": 600, "slots": 8, **changes}
    run("chain_recoveries", out, failures=str(found / "failures_train.npz"), **settings)


@pytest.fixture(scope="module")
def alone(found, tmp_path_factory):
    out = tmp_path_factory.mktemp("alone")
    learn(found, out)
    return out


@pytest.fixture(scope="module")
def learnt(found, tmp_path_factory):
    out = tmp_path_factory.mktemp("learnt")
    compare(found, out / "run", records=str(out / "records"))
    return out


def evaluate(learnt, out, **changes):
    settings = {"learners": ["rc", "pp"], "seeds": [0], "episodes": 20, **changes}
    run("evaluate_chains", out, **{"learnt": str(learnt / "run"), **settings})


def moved(**variants):
    return {"learners": ["rc"], "failures": 3, "robosuite_failures": 0, "variants": variants}


def test_learning_leaves_a_policy_its_curves_and_no_checkpoint(alone):
    summary = load_json(alone / "summary.json", schema="chain_summary", version=1)
    assert summary["control_steps"] >= 600
    rounds, evaluations = (pd.read_csv(alone / f"{name}.csv") for name in ("rounds", "evaluations"))
    assert rounds["control_steps"].iloc[-1] == summary["control_steps"]
    assert (rounds.filter(like="chosen:").sum(axis=1) == SMALL["n_steps"]).all()
    assert evaluations["control_steps"].iloc[0] == 0
    assert evaluations["success"].max() == summary["best_evaluation"]
    assert load_policy(alone).card.learner == "rc"
    assert not (alone / FILE).exists()


def test_runs_that_are_compared_are_those_that_a_person_would_start(alone, learnt):
    out = learnt / "run"
    ours, theirs = (load_policy(folder) for folder in (out / "policies" / "rc" / "s0", alone))
    assert all(torch.equal(weight, theirs.weights[name]) for name, weight in ours.weights.items())
    rounds = pd.read_csv(out / "rounds.csv")
    assert rounds.groupby("learner")["seed"].unique().map(list).to_dict() == {"pp": [0], "rc": [0]}
    summary = load_json(out / "summary.json", schema="chain_runs", version=1)["runs"]
    assert set(summary) == {"rc/s0", "pp/s0"}
    assert (out / "policies" / "pp" / "s0" / "preconditions.npz").is_file()
    assert not list(out.rglob(FILE))


def test_what_the_records_hold_is_not_learnt_again(found, learnt, tmp_path):
    shutil.copytree(learnt / "records", tmp_path / "records")
    changed = {path: path.stat().st_mtime_ns for path in (tmp_path / "records").rglob("*.*")}
    compare(found, tmp_path / "run", records=str(tmp_path / "records"))
    assert changed == {path: path.stat().st_mtime_ns for path in (tmp_path / "records").rglob("*.*")}
    assert not (tmp_path / "run" / "runs").exists()
    pd.testing.assert_frame_equal(*(pd.read_csv(one / "run" / "evaluations.csv") for one in (learnt, tmp_path)))
    for name in ("rc", "pp"):
        ours, theirs = (load_policy(one / "run" / "policies" / name / "s0") for one in (learnt, tmp_path))
        assert policy_hash(ours) == policy_hash(theirs)

    # A policy that is not whole, or another configuration, is learnt anew.
    kept = tmp_path / "records" / "policies" / "push-rc-s0" / "policy.safetensors"
    kept.write_bytes(kept.read_bytes()[:-4])
    compare(found, tmp_path / "again", records=str(tmp_path / "records"), compare=["rc"])
    assert (tmp_path / "again" / "runs" / "s0" / "rc").exists()
    assert policy_hash(load_policy(kept.parent)) == policy_hash(load_policy(learnt / "run/policies/rc/s0"))


def test_every_learner_meets_the_same_nominal_runs_and_failures(learnt, tmp_path):
    evaluate(learnt, tmp_path / "a", records=str(tmp_path / "records"), transfer=moved(noisy={"sigma_m": 0.05}))
    episodes = load_table(tmp_path / "a" / "episodes.parquet", schema="chain_episodes", version=1)
    parts = {name: part.reset_index(drop=True) for name, part in episodes.groupby("learner")}
    for column in ("nominal", "flagged", "diverged"):
        pd.testing.assert_series_equal(parts["rc"][column], parts["pp"][column])
    assert (episodes["success"] >= episodes["nominal"]).all()
    assert ((episodes["actions"] != "") == episodes["flagged"]).all()
    summary = load_json(tmp_path / "a" / "summary.json", schema="chain_evaluation", version=1)["learners"]
    assert summary["rc"]["success"]["mean"] == parts["rc"]["success"].mean()
    assert summary["rc"]["recovery"]["n"] == parts["rc"]["flagged"].sum()
    by_strategy = pd.read_csv(tmp_path / "a" / "strategies_5.csv").query("metric == 'recovery'")
    recovered = parts["rc"]["flagged"] & parts["rc"]["success"]
    assert by_strategy["n"].sum() == parts["rc"]["flagged"].sum()
    assert (by_strategy["n"] * by_strategy["mean"]).sum() == pytest.approx(recovered.sum())
    elsewhere = pd.read_csv(tmp_path / "a" / "table_5_2.csv").query("metric == 'recovery'")
    assert elsewhere["setting"].tolist() == ["world=push;variant=noisy", "world=push;variant=noisy;seed=0"]
    assert elsewhere[["method", "n"]].to_numpy().tolist() == [["rc", 3], ["rc", 3]]

    # The video of a start outside nominal ones, where there is one, and something to draw with.
    index = load_json(tmp_path / "a" / "videos" / "videos.json", schema="videos", version=1)
    films = [path.name for path in (tmp_path / "a" / "videos").glob("*.mp4")]
    assert films == [one["file"] for one in index["videos"]]
    assert bool(films) != bool(index["skipped"])

    # Another machine has the records alone: nothing is run, and the results are the same.
    changed = {path: path.stat().st_mtime_ns for path in (tmp_path / "records").iterdir()}
    assert len(changed) == 4
    evaluate(learnt, tmp_path / "b", records=str(tmp_path / "records"), transfer=moved(noisy={"sigma_m": 0.05}))
    assert changed == {path: path.stat().st_mtime_ns for path in (tmp_path / "records").iterdir()}
    for name in (
        "table_5_1.csv",
        "table_5_2.csv",
        "figure_5_5.csv",
        "figure_5_8.csv",
        "figure_5_9.csv",
        "strategies_5.csv",
        "figure_5_9.png",
    ):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()


def test_every_level_of_uncertainty_is_judged_with_the_policies_learnt_under_it(found, learnt, tmp_path):
    shutil.copytree(learnt / "run", tmp_path / "run")
    ablation = {"learner": "rc", "variants": {"double": {"sigma_m": 0.06}}}
    given = {"learners": ["rc"], "records": str(tmp_path / "records"), "ablation": ablation}
    with pytest.raises(ArtifactError, match=r"run_double: holds no policy of rc s0; it has none"):
        evaluate(tmp_path, tmp_path / "a", **given)
    noisy = {"name": "push", "params": {"sigma_m": 0.06, "nthread": 1}}
    executions = {"train": 20, "held_out": 4}
    run("discover", tmp_path / "found", strategy="first_flag", world=noisy, executions=executions)
    compare(tmp_path / "found", tmp_path / "run_double", world=noisy, compare=["rc"])
    for out in ("a", "b"):
        evaluate(tmp_path, tmp_path / out, **given)
    table = pd.read_csv(tmp_path / "a" / "ablation_5.csv")
    assert table["setting"].unique().tolist() == ["world=push;variant=as_given", "world=push;variant=double"]
    nominal = table[table["metric"] == "nominal"]["mean"].tolist()
    assert nominal[0] > nominal[1]
    assert {"success", "recovery", "primitives", "open_loop"} < set(table["metric"])
    assert (tmp_path / "a" / "ablation_5.csv").read_bytes() == (tmp_path / "b" / "ablation_5.csv").read_bytes()
    kept = sorted(path.name for path in (tmp_path / "records").iterdir())
    assert [name.rpartition("-s0")[0] for name in kept] == [
        "push-rc_episodes",
        "push-rc_reuse",
        "push_double-rc_episodes",
    ]


def test_a_policy_of_another_variant_is_refused_before_anything_is_run(learnt, tmp_path):
    other = {"name": "push", "params": {"sigma_m": 0.01, "nthread": 1}}
    with pytest.raises(ArtifactError, match="other parameters or code"):
        evaluate(learnt, tmp_path, world=other, learners=["rc"])
    with pytest.raises(ArtifactError, match=r"holds no policy of rc s7; it has pp s0, rc s0"):
        evaluate(learnt, tmp_path, learners=["rc"], seeds=[7])
    (tmp_path / "run").mkdir()
    shutil.copytree(learnt / "run" / "policies", tmp_path / "run" / "policies")
    with pytest.raises(ArtifactError, match=r"rounds\.csv: cannot be read"):
        evaluate(tmp_path, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["run"]


def test_policies_that_are_missing_are_all_named_with_those_that_are_there(learnt, tmp_path):
    with pytest.raises(
        ArtifactError, match=r"no policy of rc s4, lazy_rc s0 s4; it has pp s0, rc s0\. Train .*=\[lazy_rc,rc\]"
    ):
        evaluate(learnt, tmp_path, learners=["rc", "lazy_rc"], seeds=[0, 4])
    with pytest.raises(ArtifactError, match=r"run_half: holds no policy of rc s0; it has none"):
        evaluate(learnt, tmp_path, ablation={"learner": "rc", "variants": {"half": {}}})
    assert not any(tmp_path.iterdir())


def test_a_run_that_is_not_whole_says_what_it_lacks(alone, tmp_path):
    shutil.copytree(alone, tmp_path / "run")
    (tmp_path / "run" / FILE).touch()
    with pytest.raises(ArtifactError, match=r"run: this run has not finished; .*hydra\.run\.dir=.*run goes on with it"):
        evaluate(tmp_path, tmp_path, learners=["rc"])
    (tmp_path / "run" / FILE).unlink()
    (tmp_path / "run" / "evaluations.csv").unlink()
    with pytest.raises(ArtifactError, match=r"evaluations\.csv: .*put it back, or learn them anew with `[^`]*`$"):
        evaluate(tmp_path, tmp_path, learners=["rc"])
    (tmp_path / "run" / "policy.safetensors").unlink()
    with pytest.raises(ArtifactError, match=r"policy\.safetensors: missing beside its card; put it back, or learn"):
        load_policy(tmp_path / "run")


def test_a_table_without_rows_says_why(learnt, tmp_path, capsys):
    transfer = {"learners": ["rc"], "failures": 3, "robosuite_failures": 0, "variants": {}}
    evaluate(learnt, tmp_path, learners=["pp"], transfer=transfer, reuse={"learners": [], "nominal_runs": 4})
    told = capsys.readouterr().out
    assert "table_5_2 has no rows, since transfer.learners names rc; evaluated are pp" in told
    assert "figure_5_9 has no rows, since reuse.learners names nobody" in told
    index = load_json(tmp_path / "videos" / "videos.json", schema="videos", version=1)
    assert index["skipped"] == "no learner of reuse.learners met a failure"


@pytest.mark.parametrize(
    ("place", "section"),
    [
        (
            "transfer.learners",
            {"transfer": {"learners": ["rc", "serch"], "failures": 0, "robosuite_failures": 0, "variants": {}}},
        ),
        ("reuse.learners", {"reuse": {"learners": ["serch"], "nominal_runs": 4}}),
        ("ceiling.learner", {"ceiling": {"learner": "serch", "macros": 4}}),
        ("ablation.learner", {"ablation": {"learner": "serch", "variants": {}}}),
    ],
)
def test_a_name_that_no_learner_has_is_a_mistake_and_not_a_table_left_out(learnt, tmp_path, place, section):
    with pytest.raises(ConfigError, match=rf"{place} names serch, .*known: rc, pp, lazy_rc, rl, search, search_mixed"):
        evaluate(learnt, tmp_path, **section)


def test_every_evaluation_is_told_while_it_learns(found, tmp_path, capsys):
    learn(found, tmp_path, learner="search", budget=900, evaluation={"every": 300, "episodes": 4})
    told = [line for line in capsys.readouterr().out.splitlines() if line.startswith("push search s0: ")]
    table = pd.read_csv(tmp_path / "evaluations.csv")
    assert [int(line.split()[3].replace(",", "")) for line in told] == table["control_steps"].tolist()
    assert told[-1].endswith(f"succeeds in {table['success'].iloc[-1]:.0%} of 4 episodes")


def test_a_search_in_several_worlds_has_a_name_of_its_own_and_tells_each(found, tmp_path, capsys):
    params = {"mixture": {"worse": {"sigma_m": 0.05}}, "executions": 40, "trials": 16, "updates": 20}
    learner = {"name": "search", "params": params}
    learn(found, tmp_path, learner=learner, budget=900, evaluation={"every": 300, "episodes": 4})
    assert "push search_mixed s0: " in (out := capsys.readouterr().out)
    assert re.search(r"of 4 episodes of its own world; worse \d+%; \d+% of all episodes", out)
    assert load_policy(tmp_path).card.learner == "search_mixed"
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["failures:worse"] > summary["set_apart:worse"] == 4


def told_already(folder, out, **changes):
    """A valid configuration of the comparison in `learnt`, changed."""
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        plain = resolve(compose("chain_recoveries", ["experiment=smoke"]))
    plain["ppo"] |= SMALL
    plain |= {
        "limits": plain["limits"] | {"fields": []},
        "limits_of": {},
        "records": None,
        "item": "push",
        "world": PUSH,
    }
    plain |= {
        "failures": str(folder / "failures_train.npz"),
        "learners": COMPARED,
        "compare": ["rc", "pp"],
        "seeds": [0],
    }
    return already(validate(plain | {"budget": 600, "slots": 8, **changes}, ChainRecoveriesConfig, "test"), out)


def test_runs_that_are_there_are_not_overwritten_by_other_ones(found, learnt, alone, tmp_path):
    """A second comparison in the folder of a finished one wrote over its tables and its policies without a word."""
    there = learnt / "run"
    assert told_already(found, there) is None, "the same one goes on"
    assert told_already(found, there, seeds=[0, 1]) is None, "and may grow"
    with pytest.raises(
        ArtifactError, match=r"holds pp s0 of another comparison or configuration.*choose another folder"
    ):
        told_already(found, there, compare=["rc"])
    with pytest.raises(ArtifactError, match=r"holds pp s0, rc s0 of another comparison or configuration"):
        told_already(found, there, budget=900)
    with pytest.raises(ArtifactError, match=r"holds pp s0, rc s0 of another"):
        told_already(found, there, compare=[], seeds=[])
    with pytest.raises(ArtifactError, match=r"holds a single run of another"):
        told_already(found, alone)
    assert told_already(found, tmp_path) is None


def test_seeds_without_a_comparison_and_names_given_twice_are_mistakes(found, tmp_path):
    with pytest.raises(ConfigError, match=r"seeds are those of compare.* say compare=\[rc\], or seed=3 for one run"):
        learn(found, tmp_path, seeds=[3, 4])
    with pytest.raises(ConfigError, match=r"compare names something twice: rc, rc"):
        compare(found, tmp_path, compare=["rc", "rc"])
    with pytest.raises(ConfigError, match=r"seeds names something twice: 0, 0"):
        compare(found, tmp_path, seeds=[0, 0])


def test_a_variant_that_is_refused_is_named_and_a_result_is_told(learnt, tmp_path, capsys):
    with pytest.raises(ConfigError, match=r"transfer\.variants\.far: .*unknown parameters"):
        evaluate(learnt, tmp_path, transfer=moved(far={"sigma": 0.05}))
    evaluate(learnt, tmp_path, learners=["rc"], videos=False)
    told = re.search(
        r"evaluate_chains push: success nominal (.*)% \(.*\), rc (.*)% \(.*\), of (\d+) episodes",
        capsys.readouterr().out,
    )
    table = pd.read_csv(tmp_path / "table_5_1.csv")
    summary = load_json(tmp_path / "summary.json", schema="chain_evaluation", version=1)["learners"]["rc"]
    assert float(told[1]) == pytest.approx(100 * summary["nominal"]["mean"], abs=0.05)
    assert float(told[2]) == pytest.approx(100 * summary["success"]["mean"], abs=0.05)
    assert len(table)


def test_what_cannot_be_learnt_from_is_refused(found, tmp_path):
    with pytest.raises(ArtifactError, match=r"no failures of 'push' have been recorded.*dvc repro discover@push"):
        run("chain_recoveries", tmp_path, failures=str(tmp_path / "none" / "failures_train.npz"))
    with pytest.raises(ArtifactError, match="expected those of 'door'"):
        learn(found, tmp_path, world={"name": "door", "params": {}})
    with pytest.raises(ArtifactError, match=r"under estimator=fixed, the configuration says exact; say world\.params"):
        learn(found, tmp_path, world={"name": "push", "params": {**PUSH["params"], "estimator": "exact"}})
    unseen = {"decisions": 10, "primitive_steps": 100, "history": 1, "fields": ["grip_pos_m", "felt_force"]}
    refusal = r"limits\.fields names felt_force, which world 'push' .*it observes: grip_pos_m"
    with pytest.raises(ConfigError, match=refusal):
        learn(found, tmp_path, limits=unseen)
    with pytest.raises(ConfigError, match="less than one round of 24 decisions of 10 control steps; give at least 240"):
        learn(found, tmp_path, budget=239)
    with pytest.raises(
        ConfigError, match=r"learner\.name: given 'sac'; unknown learner 'sac'; known: lazy_rc, pp, rc, rl, search"
    ):
        learn(found, tmp_path, "sac")
    with pytest.raises(ConfigError, match="no dense reward for world 'push'"):
        learn(found, tmp_path, "rl")
    sure = {"name": "push", "params": {"sigma_m": 0.0, "nthread": 1}}
    nothing = tmp_path / "nothing"
    run("discover", nothing, strategy="first_flag", world=sure, executions={"train": 3, "held_out": 1})
    with pytest.raises(ConfigError, match="no failures of world 'push' to recover from; find some with"):
        learn(nothing, tmp_path, world=sure)
    assert [path.name for path in tmp_path.iterdir()] == ["nothing"]


def test_a_checkpoint_of_another_configuration_is_refused(found, tmp_path, monkeypatch):
    monkeypatch.setattr(chain_recoveries, "drop_checkpoint", lambda folder: None)
    learn(found, tmp_path)
    with pytest.raises(ArtifactError, match="left by a run with another configuration"):
        learn(found, tmp_path, budget=700)
    rounds = pd.read_csv(tmp_path / "rounds.csv")
    file = tmp_path / "checkpoint.safetensors"
    whole = file.read_bytes()
    file.write_bytes(whole[:-9])
    with pytest.raises(ArtifactError, match=r"checkpoint\.safetensors: damaged, or .*; delete it and .*to start"):
        learn(found, tmp_path)
    file.write_bytes(whole)
    learn(found, tmp_path)
    assert json.loads((tmp_path / "summary.json").read_text())["control_steps"] == rounds["control_steps"].iloc[-1]


def test_a_finished_run_is_neither_repeated_nor_overwritten(found, tmp_path, monkeypatch, capsys):
    """Started as the command line starts it, with a store."""
    monkeypatch.setattr(_stage, "_command", lambda name: f"python -m stages.{name}")
    out, store = tmp_path / "out", f"sqlite:///{tmp_path / 'runs.db'}"
    out.mkdir()

    def again(**changes):
        with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
            plain = resolve(compose("chain_recoveries", ["experiment=smoke"]))
        plain |= {"ppo": plain["ppo"] | SMALL, "limits": plain["limits"] | {"fields": []}, "limits_of": {}}
        given = {"failures": str(found / "failures_train.npz"), "budget": 600, "slots": 8, "records": None}
        plain |= {"item": "push", "world": PUSH, "tracking": {"enabled": True, "uri": store}, **given, **changes}
        function = chain_recoveries.run.__wrapped__
        _stage._run("chain_recoveries", ChainRecoveriesConfig, function, OmegaConf.create(plain), out, already, None)

    def files():
        return {path: (path.read_bytes(), path.stat().st_mtime_ns) for path in out.rglob("*") if path.is_file()}

    again()
    before = files()
    assert {"policy.safetensors", "config.yaml", "run.json", "summary.json"} <= {path.name for path in before}
    capsys.readouterr()
    again()
    assert "this run has finished already" in capsys.readouterr().out
    with pytest.raises(ArtifactError, match=r"another configuration.*What differs: budget \(600 there, 700 here\)$"):
        again(budget=700)
    assert files() == before
    client = MlflowClient(tracking_uri=store)
    assert len(client.search_runs([client.get_experiment_by_name("chain_recoveries").experiment_id])) == 1


def test_what_another_clone_has_learnt_meanwhile_is_not_learnt_again(found, learnt, tmp_path, monkeypatch):
    learnt_here = []
    prepare = comparison.prepare

    def slow(run, failures, path):
        shutil.copytree(learnt / "records", tmp_path / "records", dirs_exist_ok=True)
        learnt_here.append(run.name)
        return prepare(run, failures, path)

    monkeypatch.setattr(comparison, "prepare", slow)
    compare(found, tmp_path / "run", records=str(tmp_path / "records"), compare=["rc"])
    assert learnt_here == ["rc"]
    assert not (tmp_path / "run" / "runs").exists()
    assert (tmp_path / "run" / "policies" / "rc" / "s0" / "policy.safetensors").is_file()


def test_nobody_learns_if_one_of_those_compared_is_refused(found, tmp_path):
    both = {"rc": {"name": "rc"}, "rl": {"name": "rl"}}
    with pytest.raises(ConfigError, match="no dense reward for world 'push'"):
        compare(found, tmp_path / "a", learners=both, compare=["rc", "rl"])
    less = {"rc": {"name": "rc"}, "lazy_rc": {"name": "lazy_rc", "budget_share": 0.3}}
    with pytest.raises(ConfigError, match="a budget of 180 control steps is less than one round"):
        compare(found, tmp_path / "b", learners=less, compare=["rc", "lazy_rc"])
    assert not list(tmp_path.rglob("*.safetensors"))


def test_a_single_run_can_be_judged_where_it_lies(alone, tmp_path):
    run("evaluate_chains", tmp_path / "a", learnt=str(alone), learners=["rc"], seeds=[0], episodes=10)
    table = pd.read_csv(tmp_path / "a" / "table_5_1.csv")
    assert table.query("method == 'rc' and setting == 'world=push' and metric == 'success'")["n"].item() == 10
    with pytest.raises(ArtifactError, match="the policy of rc, seed 0, not of pp, seed 0; say learners="):
        run("evaluate_chains", tmp_path / "b", learnt=str(alone), learners=["pp"], seeds=[0])


def test_a_learner_of_ones_own_is_compared_and_judged(found, tmp_path):
    """The one of docs/chains.md."""
    LEARNERS.register("short", "tests.stages.short_learner:learner")
    both = {name: {"name": name, "params": {}} for name in ("rc", "short")}
    compare(found, tmp_path / "run", learners=both, compare=["rc", "short"])
    evaluate(tmp_path, tmp_path / "judged", learners=["rc", "short"])
    table = pd.read_csv(tmp_path / "judged" / "table_5_1.csv")
    assert {"nominal", "rc", "short"} == set(table["method"])


def test_a_killed_training_goes_on_in_the_same_run(found, tmp_path):
    store, out = f"sqlite:///{tmp_path / 'runs.db'}", tmp_path / "out"
    client = MlflowClient(tracking_uri=store)
    script = KILL.format(checkpoints=3)
    killed = [sys.executable, "-c", script, str(found), str(out), store]
    ended = waiting.run(killed, cwd=ROOT)
    assert ended.returncode == -signal.SIGKILL, ended.stderr
    experiment = client.get_experiment_by_name("chain_recoveries").experiment_id
    before = {each.info.run_id for each in client.search_runs([experiment])}
    [left] = out.rglob(FILE)
    kept = load_json(left.with_suffix(".safetensors.json"), schema="chain_checkpoint", version=1)
    assert 0 < kept["control_steps"] < TRACKED["budget"]
    with tracked(out, store) as track:
        compare(found, out, track=track, tracking={"enabled": True, "uri": store}, **TRACKED)
    runs = client.search_runs([experiment])
    assert {each.info.run_id for each in runs} == before, "none is new"
    assert {each.info.status for each in runs} == {"FINISHED"}
    assert len(runs) == 2  # the comparison and its one learner
    evaluations = pd.read_csv(out / "evaluations.csv")
    assert evaluations["control_steps"].iloc[: len(kept["evaluations"])].tolist() == [
        row["control_steps"] for row in kept["evaluations"]
    ]
    assert evaluations["control_steps"].iloc[-1] >= TRACKED["budget"]


LEARN = """
import sys
from pathlib import Path
from tests.stages.test_chain_stages import TRACKED, compare
compare(Path(sys.argv[1]), Path(sys.argv[2]), **TRACKED)
"""


def test_neither_threads_nor_hash_seeds_change_a_policy(found, tmp_path):
    """371 weights once depended on OMP_NUM_THREADS, by up to 1.2e-4."""
    policies = []
    for threads, hash_seed in (("1", "0"), ("2", "7")):
        out = tmp_path / threads
        known = {**os.environ, "OMP_NUM_THREADS": threads, "PYTHONHASHSEED": hash_seed}
        words = [sys.executable, "-c", LEARN, str(found), str(out)]
        waiting.run(words, cwd=ROOT, env=known, check=True)
        policies.append((out / "policies/rc/s0/policy.safetensors").read_bytes())
    assert policies[0] == policies[1]


def test_watch_films_a_failure_beside_its_recovery(alone, found, tmp_path, capsys):
    try:
        backend()
    except NoGLError as error:
        pytest.skip(str(error))
    small = {"video": {"width": 64, "height": 48, "max_frames": 4, "hold_s": 0.0, "samples": 0}}
    failures = {"failures": str(found / "failures_train.npz")}
    run("watch", tmp_path, policy=str(alone), failure=1, **failures, **small)
    run("watch", tmp_path, policy=str(alone), **failures, **small)
    told = capsys.readouterr().out.splitlines()
    assert [Path(line.split(": ")[0]).name for line in told] == ["push-failure1-recovery.mp4", "push-recovery.mp4"]
    assert all(
        re.search(r": failure: missed in (align|push) after .* s; (not )?recovered.*: \w", line) for line in told
    )
    reader = imageio_ffmpeg.read_frames(str(tmp_path / "push-recovery.mp4"))
    assert next(reader)["size"] == (128, 60)  # two pictures, and a line of text below
    other = {"name": "push", "params": {"sigma_m": 0.01, "nthread": 1}}
    with pytest.raises(ArtifactError, match="other parameters or code"):
        run("watch", tmp_path / "other", policy=str(alone), world=other, **failures, **small)
    assert list((tmp_path / "other").iterdir()) == []


def test_the_recovery_filmed_starts_where_the_nominal_skills_failed(alone, found):
    failures = load_failures(found / "failures_train.npz")
    world, nominal = open_world(failures, found)
    agent, _ = load_agent(alone, world, nominal, failures.rows)
    one = failures.take([2])
    failure = nominal_clip(world, nominal, one.start)
    assert (failure.flagged, failure.done, len(failure.rows)) == (True, False, int(one.step[0]) + 1)
    np.testing.assert_array_equal(failure.rows.states[-1], one.rows.states[0])
    recovery = recovery_clip(world, nominal, agent, one.rows)
    went = recover(world, nominal, agent, one.rows)
    assert recovery.done == went.success[0]
    assert len(recovery.actions) == (went.actions >= 0).sum()
    assert list(dict.fromkeys(recovery.captions)) == [
        f"recovery {number}: {name}" for number, name in enumerate(recovery.actions, 1)
    ]


def test_what_has_been_judged_needs_no_weights(found, learnt, tmp_path):
    """Records without weights: nothing is learnt or run again, and a policy that is asked to act says why it cannot."""
    shutil.copytree(learnt / "records", tmp_path / "records")
    records = {"records": str(tmp_path / "records")}
    compare(found, tmp_path / "run", **records)
    evaluate(tmp_path, tmp_path / "judged", transfer=moved(near={"sigma_m": 0.03}), videos=False, **records)
    for weights in (tmp_path / "records").rglob("policy.safetensors"):
        weights.unlink()
    shutil.rmtree(tmp_path / "run")
    changed = {path: path.stat().st_mtime_ns for path in (tmp_path / "records").rglob("*.*")}
    compare(found, tmp_path / "run", **records)
    assert not (tmp_path / "run" / "runs").exists()
    assert not list((tmp_path / "run").rglob("policy.safetensors"))
    evaluate(tmp_path, tmp_path / "again", transfer=moved(near={"sigma_m": 0.03}), videos=False, **records)
    for name in ("table_5_1.csv", "table_5_2.csv", "figure_5_9.csv"):
        assert (tmp_path / "again" / name).read_bytes() == (tmp_path / "judged" / name).read_bytes()
    assert changed == {path: path.stat().st_mtime_ns for path in (tmp_path / "records").rglob("*.*")}
    with pytest.raises(ArtifactError, match=r"rc, seed 0, in world 'push': only the card .* learner=rc seed=0"):
        evaluate(tmp_path, tmp_path / "other", episodes=21, videos=False, **records)
    compare(found, tmp_path / "anew", records=None, compare=["rc"])  # who has the weights, has them all
    assert policy_hash(load_policy(tmp_path / "anew/policies/rc/s0")) == policy_hash(
        load_policy(tmp_path / "run/policies/rc/s0")
    )
