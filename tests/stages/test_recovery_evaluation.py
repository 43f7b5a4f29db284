"""The stage evaluate_recoveries on the small push world: items, tables, and what it refuses."""

import shutil

import pandas as pd
import pytest

from p2l.artifacts import load_json, load_table
from p2l.errors import ArtifactError
from stages import evaluate_recoveries
from tests.stages import recovering

recovering.STAGES["evaluate_recoveries"] = evaluate_recoveries
TABLES = ("table_4_1", "table_4_2", "figure_4_6", "figure_4_7", "success_within")


@pytest.fixture(scope="module")
def learnt(tmp_path_factory):
    folder = tmp_path_factory.mktemp("push")
    recovering.prepare(folder)
    learn(folder, folder / "learn", folder / "records")
    return folder


def learn(folder, out, records):
    recovering.learn(folder, out, compare=["metareskill", "round_robin"], seeds=[0, 1], records=str(records))


def evaluate(learnt, out, **changes):
    files = {name: recovering.found(learnt)[name] for name in ("modes", "preconditions")}
    settings = {"learnt": str(learnt / "learn"), "handles": [], "robosuite_seeds": [], "episodes": 6, "seeds": [0, 1]}
    recovering.run("evaluate_recoveries", out, **{**files, **settings, **changes})


def test_every_item_leaves_a_record_and_every_strategy_meets_the_same_starts(learnt, tmp_path):
    evaluate(learnt, tmp_path / "a", records=str(tmp_path / "records"))
    episodes = load_table(tmp_path / "a" / "episodes.parquet", schema="recovery_episodes", version=1)
    assert episodes.groupby(["method", "seed"]).size().tolist() == [6] * 14
    assert len(list((tmp_path / "records").iterdir())) == 14
    table = pd.read_csv(tmp_path / "a" / "table_4_1.csv").fillna({"setting": ""})
    pooled = table[(table["metric"] == "success") & (table["setting"] == "")]
    trained = pooled["method"].isin(["recoveries", "recoveries_repeating"])
    assert (pooled["n"][trained] == 2).all()  # trainings
    assert (pooled["n"][~trained] == 12).all()  # episodes
    assert len(table[(table["metric"] == "gain") & ~table["setting"].str.startswith("seed=")]) == 6
    assert len(pd.read_csv(tmp_path / "a" / "table_4_2.csv")) == 0
    assert load_json(tmp_path / "a" / "summary.json", schema="recovery_evaluation", version=1)["headline"]

    # Another machine has the records alone: no episode is run, and the results are the same.
    times = {path.name: path.stat().st_mtime_ns for path in (tmp_path / "records").iterdir()}
    evaluate(learnt, tmp_path / "b", records=str(tmp_path / "records"))
    assert times == {path.name: path.stat().st_mtime_ns for path in (tmp_path / "records").iterdir()}
    for name in TABLES:
        assert (tmp_path / "a" / f"{name}.csv").read_bytes() == (tmp_path / "b" / f"{name}.csv").read_bytes()
    for name in TABLES[2:]:
        assert (tmp_path / "a" / f"{name}.png").read_bytes() == (tmp_path / "b" / f"{name}.png").read_bytes()


def test_training_goes_on_from_the_records_of_another_machine(learnt, tmp_path):
    records = tmp_path / "records"
    shutil.copytree(learnt / "records", records)
    times = {path.name: path.stat().st_mtime_ns for path in records.glob("*.npz")}
    assert sorted(times) == ["push-ledger-s0.npz", "push-ledger-s1.npz"]
    learn(learnt, tmp_path / "learn", records)
    assert times == {path.name: path.stat().st_mtime_ns for path in records.glob("*.npz")}  # nothing was asked again
    assert (tmp_path / "learn" / "rounds.csv").read_bytes() == (learnt / "learn" / "rounds.csv").read_bytes()
    record = load_json(records / "push-metareskill-s0-b0.json", schema="item_record", version=1)
    assert len(record["content"]["rounds"]["value"]) == 16


def test_recoveries_of_another_world_or_cluster_file_are_refused(learnt, tmp_path):
    other = recovering.WORLD | {"params": recovering.WORLD["params"] | {"sigma_m": 0.02}}
    with pytest.raises(ArtifactError, match="preconditions of world"):
        evaluate(learnt, tmp_path, world=other)
    files = {name: recovering.found(learnt)[name] for name in ("failures", "held_out")}
    recovering.run("cluster", tmp_path / "cluster", **files, videos=False, seed=3, restarts=1, regularisation=0.5)
    with pytest.raises(ArtifactError, match="learnt with another modes"):
        evaluate(learnt, tmp_path, modes=str(tmp_path / "cluster" / "modes.npz"))
    with pytest.raises(ArtifactError, match="no such artifact"):
        evaluate(learnt, tmp_path, seeds=[0, 7])
