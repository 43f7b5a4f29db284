"""The stages chain_recoveries and evaluate_chains, on the small push world: what they write, and what they refuse."""

import json
from pathlib import Path

import pandas as pd
import pytest
from hydra import compose, initialize_config_dir

from p2l.artifacts import load_json, load_table
from p2l.errors import ArtifactError, ConfigError
from p2l.recoveries.chaining.checkpoint import FILE
from p2l.recoveries.chaining.policy import load_policy
from p2l.schema import SCHEMAS, resolve, validate
from p2l.tracking import Tracker
from stages import chain_recoveries, discover, evaluate_chains
from tests.failures import pushing

ROOT = Path(__file__).resolve().parents[2]
STAGES = {"discover": discover, "chain_recoveries": chain_recoveries, "evaluate_chains": evaluate_chains}
PUSH = {"name": "push", "params": {"sigma_m": 0.03, "nthread": 1}}
SMALL = {"n_steps": 24, "batch_size": 12, "n_epochs": 1, "hidden": [8]}
assert pushing.found  # importing it registers the world


def run(name, out, **changes):
    """Run a stage in this process, on push, with values of its configuration changed."""
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        plain = resolve(compose(name, ["experiment=smoke"]))
    if "ppo" in plain:
        plain["ppo"] |= SMALL
    plain |= {"item": "push", "world": PUSH, **changes}
    out.mkdir(parents=True, exist_ok=True)
    STAGES[name].run.__wrapped__(validate(plain, SCHEMAS[name], "test"), out, Tracker())


def learn(found, out, learner="rc", **changes):
    params = {"trajectories": 60, "every": 2} if learner == "pp" else {}
    settings = {"learner": {"name": learner, "params": params}, "budget": 600, "slots": 8, **changes}
    run("chain_recoveries", out, failures=str(found / "failures_train.npz"), **settings)


@pytest.fixture(scope="module")
def found(tmp_path_factory):
    out = tmp_path_factory.mktemp("discover")
    run("discover", out, strategy="first_flag", executions={"train": 40, "held_out": 4})
    return out


@pytest.fixture(scope="module")
def policies(found, tmp_path_factory):
    out = tmp_path_factory.mktemp("policies")
    for learner in ("rc", "pp"):
        learn(found, out / learner / "s0", learner)
    return out


def test_learning_leaves_a_policy_its_curves_and_no_checkpoint(policies):
    out = policies / "rc" / "s0"
    summary = load_json(out / "summary.json", schema="chain_summary", version=1)
    assert summary["control_steps"] >= 600
    rounds, evaluations = (pd.read_csv(out / f"{name}.csv") for name in ("rounds", "evaluations"))
    assert rounds["control_steps"].iloc[-1] == summary["control_steps"]
    assert (rounds.filter(like="chosen:").sum(axis=1) == SMALL["n_steps"]).all()
    assert evaluations["control_steps"].iloc[0] == 0
    assert evaluations["success"].max() == summary["best_evaluation"]
    assert load_policy(out).card.learner == "rc"
    assert not (out / FILE).exists()


def test_every_learner_meets_the_same_nominal_runs_and_failures(policies, tmp_path):
    run("evaluate_chains", tmp_path, policies=str(policies), learners=["rc", "pp"], seeds=[0], episodes=20)
    episodes = load_table(tmp_path / "episodes.parquet", schema="chain_episodes", version=1)
    parts = {name: part.reset_index(drop=True) for name, part in episodes.groupby("learner")}
    for column in ("nominal", "flagged", "diverged"):
        pd.testing.assert_series_equal(parts["rc"][column], parts["pp"][column])
    assert (episodes["success"] >= episodes["nominal"]).all()
    assert ((episodes["actions"] != "") == episodes["flagged"]).all()
    summary = load_json(tmp_path / "summary.json", schema="chain_evaluation", version=1)["learners"]
    assert summary["rc"]["success"]["mean"] == parts["rc"]["success"].mean()
    assert summary["rc"]["recovery"]["n"] == parts["rc"]["flagged"].sum()


def test_a_policy_of_another_variant_is_refused_before_anything_is_run(policies, tmp_path):
    other = {"name": "push", "params": {"sigma_m": 0.01, "nthread": 1}}
    with pytest.raises(ArtifactError, match="other parameters or code"):
        run("evaluate_chains", tmp_path, world=other, policies=str(policies), learners=["rc"], seeds=[0])
    with pytest.raises(ArtifactError, match=r"s7/policy\.safetensors.*no such artifact"):
        run("evaluate_chains", tmp_path, policies=str(policies), learners=["rc"], seeds=[7])
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_learnt_from_is_refused(found, tmp_path):
    with pytest.raises(ArtifactError, match="expected those of 'door'"):
        learn(found, tmp_path, world={"name": "door", "params": {}})
    with pytest.raises(ConfigError, match="less than one round of 24 decisions of 10 control steps; give at least 240"):
        learn(found, tmp_path, budget=239)
    with pytest.raises(ConfigError, match=r"learner\.name: given 'sac'; unknown learner; allowed: lazy_rc, pp, rc, rl"):
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
    learn(found, tmp_path)
    assert json.loads((tmp_path / "summary.json").read_text())["control_steps"] == rounds["control_steps"].iloc[-1]
