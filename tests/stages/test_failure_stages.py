"""The stages discover, cluster and watch, on the small push world: what they write, and what they refuse."""

import json
import shutil
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hydra import compose, initialize_config_dir

from p2l.archive import digest_of
from p2l.artifacts import load_arrays, load_json
from p2l.errors import ArtifactError, ConfigError
from p2l.evaluation.video.player import NoGLError, backend
from p2l.failures.classifier import load_modes
from p2l.failures.record import load_failures, open_world, save_failures
from p2l.ledger import Item, write
from p2l.schema import SCHEMAS, resolve, validate
from p2l.tracking import Tracker
from stages import cluster, discover, watch
from tests.failures import pushing

ROOT = Path(__file__).resolve().parents[2]
STAGES = {"discover": discover, "cluster": cluster, "watch": watch}
PUSH = {"name": "push", "params": {"sigma_m": 0.03, "nthread": 1}}
assert pushing.found  # importing it registers the world


class Heard(Tracker):
    """Keeps what it is told."""

    def __init__(self):
        self.values, self.files = {}, []

    def metrics(self, values, step=None):
        self.values |= values

    def artifact(self, path, folder=None):
        self.files.append(Path(path).name)


def run(name, out, **changes):
    """Run a stage in this process, on push, with values of its configuration changed."""
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        plain = resolve(compose(name, ["experiment=smoke"]))
    plain |= {"item": "push", "world": PUSH, **changes}
    out.mkdir(exist_ok=True)
    heard = Heard()
    STAGES[name].run.__wrapped__(validate(plain, SCHEMAS[name], "test"), out, heard)
    return heard


def of(folder):
    """Where `cluster` finds what `discover` left."""
    return {"failures": str(folder / "failures_train.npz"), "held_out": str(folder / "failures_held_out.npz")}


@pytest.fixture(scope="module")
def discovered(tmp_path_factory):
    out = tmp_path_factory.mktemp("discover")
    return out, run("discover", out, strategy="pessimistic", executions={"train": 40, "held_out": 20})


@pytest.fixture(scope="module")
def clustered(discovered, tmp_path_factory):
    out = tmp_path_factory.mktemp("cluster")
    return out, run("cluster", out, **of(discovered[0]))


def test_discover_leaves_two_splits_that_share_nothing(discovered):
    out, heard = discovered
    train, held_out = (load_failures(out / f"failures_{split}.npz", split) for split in ("train", "held_out"))
    assert (train.origin.executions, held_out.origin.executions) == (40, 20)
    assert not {row.tobytes() for row in train.start.states} & {row.tobytes() for row in held_out.start.states}
    assert not {row.tobytes() for row in train.start.noise} & {row.tobytes() for row in held_out.start.noise}
    summary = load_json(out / "summary.json", schema="discover_summary", version=1)
    assert (summary["train"]["failures"], summary["held_out"]["failures"]) == (len(train), len(held_out))
    assert (summary["strategy"], summary["estimator"]) == ("pessimistic", "fixed")
    assert heard.values["episodes_per_s"] > 0
    assert not [name for name in summary if "_per_s" in name or "seconds" in name]  # it differs from machine to machine
    assert json.loads((out / "times.json").read_text())["seconds"] > 0
    assert heard.values["train/success"] == summary["train"]["success"]["mean"]


def test_discover_again_finds_the_same_and_another_seed_others(discovered, tmp_path):
    out, _ = discovered
    small = {"strategy": "pessimistic", "executions": {"train": 40, "held_out": 1}}
    for name, seed in (("same", 0), ("other", 1)):
        run("discover", tmp_path / name, seed=seed, **small)
    first, same, other = (
        load_arrays(folder / "failures_train.npz", schema="failures", version=1)["rows.states"]
        for folder in (out, tmp_path / "same", tmp_path / "other")
    )
    np.testing.assert_array_equal(first, same)
    assert first.shape != other.shape or (first != other).any()


def test_the_world_keeps_its_estimator_unless_the_strategy_or_a_person_has_one(tmp_path):
    for name, changes, mode in (
        ("early", {"strategy": "early_termination"}, "halving"),
        ("first", {"strategy": "first_flag"}, "fixed"),
        ("exact", {"strategy": "early_termination", "estimator": "exact"}, "exact"),
    ):
        run("discover", tmp_path / name, executions={"train": 2, "held_out": 1}, **changes)
        assert json.loads((tmp_path / name / "summary.json").read_text())["estimator"] == mode
        assert load_failures(tmp_path / name / "failures_train.npz").origin.params.get("estimator", "fixed") == mode


def test_cluster_leaves_a_classifier_labels_a_table_a_figure_and_videos(discovered, clustered):
    out, heard = clustered
    train = load_failures(discovered[0] / "failures_train.npz")
    world, _ = open_world(train, "test")
    modes = load_modes(out / "modes.npz", world)
    labels = load_arrays(out / "labels.npz", schema="failure_labels", version=1)
    np.testing.assert_array_equal(labels["train"], modes.classify(train.truth)[0])
    table = pd.read_csv(out / "modes.csv")
    assert table["size"].tolist() == modes.sizes.tolist() == np.bincount(labels["train"]).tolist()
    assert table["held_out"].tolist() == np.bincount(labels["held_out"], minlength=len(modes)).tolist()
    assert (labels["train"][table["typical"]] == table["mode"]).all()
    assert (out / "modes.png").stat().st_size > 10_000
    index = load_json(out / "videos" / "videos.json", schema="videos", version=1)
    assert {path.name for path in (out / "videos").glob("*.mp4")} == {one["file"] for one in index["videos"]}
    assert heard.values["modes"] == len(table) == 2
    assert {"modes.png", "modes.csv"} <= set(heard.files)


def test_cluster_refuses_what_does_not_belong_together(discovered, tmp_path):
    folder, _ = discovered
    right = of(folder)
    with pytest.raises(ArtifactError, match="holds the failures of split 'held_out'; expected 'train'"):
        run("cluster", tmp_path, **{"failures": right["held_out"], "held_out": right["failures"]})
    with pytest.raises(ArtifactError, match="world 'push'; expected those of 'door'"):
        run("cluster", tmp_path, world={"name": "door", "params": {}}, **right)
    with pytest.raises(ArtifactError, match=r"another variant.*sigma_m = 0.03, not 0.02"):
        run("cluster", tmp_path, world={"name": "push", "params": {"sigma_m": 0.02}}, **right)
    with pytest.raises(ConfigError, match="cannot make 90 modes"):
        run("cluster", tmp_path, modes={"pessimistic": 90, "early_termination": 1, "first_flag": 1}, **right)
    assert list(tmp_path.iterdir()) == []


def test_no_failure_says_what_to_do_and_leaves_nothing(tmp_path):
    sure = {"name": "push", "params": {"sigma_m": 0.0}}
    run("discover", tmp_path / "d", strategy="pessimistic", world=sure, executions={"train": 3, "held_out": 3})
    with pytest.raises(ArtifactError, match=r"no failure in 3 executions of 'push'.*more executions, or more noise"):
        run("cluster", tmp_path / "c", world=sure, **of(tmp_path / "d"))
    assert list((tmp_path / "c").iterdir()) == []


def test_watch_films_a_run_or_a_failure_and_says_where(discovered, tmp_path, capsys):
    try:
        backend()
    except NoGLError as error:
        pytest.skip(str(error))
    small = {"video": {"width": 64, "height": 48, "max_frames": 3, "hold_s": 0.0, "samples": 0}}
    failures = str(discovered[0] / "failures_train.npz")
    heard = run("watch", tmp_path, failure=1, failures=failures, **small)
    run("watch", tmp_path, **small)
    told = capsys.readouterr().out.splitlines()
    assert [line.split(": ")[0] for line in told] == [
        str(tmp_path / name) for name in ("push-failure1.mp4", "push-nominal.mp4")
    ]
    assert heard.files == ["push-failure1.mp4"]
    assert all(Path(line.split(": ")[0]).stat().st_size > 0 for line in told)
    with pytest.raises(ConfigError, match=r"failure=999: .* holds \d+, numbered from 0"):
        run("watch", tmp_path, failure=999, failures=failures, **small)


def test_a_damaged_failure_file_is_one_message(discovered, tmp_path):
    shutil.copytree(discovered[0], tmp_path / "d")
    file = tmp_path / "d" / "failures_train.npz"
    file.write_bytes(file.read_bytes()[:2000])
    with pytest.raises(ArtifactError, match=r"failures_train\.npz"):
        run("cluster", tmp_path / "c", **of(tmp_path / "d"))


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("world.name=doors",), ("world.name: given 'doors'", "known: cluttered_shelf, door, nut, pick_place")),
        (("world=doors",), ("world/doors", "pick_place")),
        (("world.params.arm=Kuka",), ("unknown arm 'Kuka'", "Panda", "UR5e")),
        (("world.params.handle=9",), ("unknown handle 9", "1, 2, 3, 4, 5")),
        (("+world.params.colour=red",), ("unknown parameters ['colour']", "force_limit_n")),
        (("world.params.x_m=[0.5,0.4]",), ("x_m must be [low, high]", "[0.5, 0.4]")),
        (("executions.train=0", "strategy=lucky"), ("executions.train: given '0'", "strategy: given 'lucky'")),
    ],
)
def test_a_mistake_is_one_message_and_leaves_nothing(tmp_path, monkeypatch, capsys, words, parts):
    out = tmp_path / "out"
    always = ("world=door", "experiment=smoke", "tracking=disabled", f"hydra.run.dir={out}")
    kept = [word for word in always if word.split("=")[0] not in {given.split("=")[0] for given in words}]
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")
    monkeypatch.setattr(sys, "argv", ["discover", *kept, *words])
    with pytest.raises(SystemExit) as left:
        discover.run()
    message = capsys.readouterr().err
    assert left.value.code == 2
    assert "Traceback" not in message
    assert [part for part in parts if part not in message] == []
    assert not out.exists()


def test_files_come_from_the_records_and_films_are_made_again(tmp_path):
    """On another processor a failure more or less was found, so that no committed ledger was valid there."""
    records, one, two = tmp_path / "records", tmp_path / "one", tmp_path / "two"
    kept = {"records": str(records)}
    told = run("discover", one, executions={"train": 6, "held_out": 4}, **kept)
    changed = load_json(records / "push-discover-s0-b0.json", schema="item_record", version=1)
    failures = load_failures(one / "failures_train.npz")
    save_failures(one / "failures_train.npz", failures.take(range(len(failures) - 1)))  # as another processor found
    [folder] = (records / "files").iterdir()
    shutil.copy(one / "failures_train.npz", folder)
    content = changed["content"]["files"] | {"failures_train.npz": digest_of(one / "failures_train.npz")}
    write(records, Item("push", "discover", 0, 0, changed["config_hash"]), {"files": content}, seconds=0.0)
    again = run("discover", two, executions={"train": 6, "held_out": 4}, slots=2, **kept)
    assert len(load_failures(two / "failures_train.npz")) == len(failures) - 1
    assert {name: value for name, value in told.values.items() if "_per_s" not in name and name != "seconds"} == (
        again.values
    )
    group = {"modes": {"pessimistic": 1, "early_termination": 1, "first_flag": 1}, "videos": False, **of(one), **kept}
    run("cluster", tmp_path / "three", **group)
    labels = (tmp_path / "three" / "labels.npz").read_bytes()
    told = run(
        "cluster",
        tmp_path / "four",
        **group,
        video={"width": 64, "height": 48, "max_frames": 2, "hold_s": 0.0, "samples": 0},
    )
    assert (tmp_path / "four" / "labels.npz").read_bytes() == labels
    assert (tmp_path / "four" / "videos" / "videos.json").is_file()
    assert told.values["modes"] == 1
    assert sorted(file.name for file in records.glob("*.json")) == [
        "push-cluster-s0-b0.json",
        "push-discover-s0-b0.json",
    ]
