"""A world that lies outside `p2l` and that nobody has registered: named by its target, from discovery to judgement."""

import shutil

import pandas as pd
import pytest
import yaml

from p2l.closure import closure
from p2l.errors import ConfigError
from p2l.failures.record import load_failures, open_world
from p2l.schema import SCHEMAS, validate
from p2l.worlds.table import make_world
from stages._bridge import code_of
from tests.stages.test_chain_stages import ROOT, evaluate, run

TARGET = "examples.push.world:Push"
MINE = {"name": "mine", "target": TARGET, "params": {"sigma_m": 0.03, "nthread": 1}}
HERE = {"item": "mine", "world": MINE}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    out = tmp_path_factory.mktemp("mine")
    run("discover", out, strategy="first_flag", executions={"train": 40, "held_out": 8}, **HERE)
    return out


def test_failures_know_how_to_build_their_world_again(folder):
    failures = load_failures(folder / "failures_train.npz")
    assert failures.origin.world == TARGET
    world, nominal = open_world(failures, folder)
    assert world.digest == failures.origin.digest
    assert tuple(option.name for option in nominal) == failures.origin.options


def test_its_failures_are_grouped_and_recovered_from(folder, tmp_path):
    files = {name: str(folder / f"failures_{name}.npz") for name in ("train", "held_out")}
    run("cluster", tmp_path / "cluster", failures=files["train"], held_out=files["held_out"], videos=False, **HERE)
    assert len(pd.read_csv(tmp_path / "cluster" / "modes.csv"))
    settings = {"learners": {"rc": {"name": "rc", "params": {}}}, "compare": ["rc"], "seeds": [0], "budget": 600}
    run("chain_recoveries", tmp_path / "run", failures=files["train"], slots=8, **settings, **HERE)
    evaluate(tmp_path, tmp_path / "judged", learners=["rc"], **HERE)
    table = pd.read_csv(tmp_path / "judged" / "table_5_1.csv")
    assert {"nominal", "rc"} == set(table["method"])
    assert table["setting"].str.startswith("world=mine").all()


def test_a_target_is_part_of_the_configuration_and_a_name_of_ours_has_none():
    plain = yaml.safe_load((ROOT / "data/config/pick_place/discover.yaml").read_text())
    ours = validate(plain, SCHEMAS["discover"], "test")
    assert "target" not in ours.model_dump()["world"]
    mine = validate({**plain, "world": MINE}, SCHEMAS["discover"], "test")
    assert mine.model_dump()["world"]["target"] == TARGET
    assert (
        mine.hash
        != validate({**plain, "world": {**MINE, "target": None, "name": "door"}}, SCHEMAS["discover"], "t").hash
    )


@pytest.mark.parametrize(
    ("world", "message"),
    [
        (
            {"name": "mine", "target": "examples.push.world"},
            "world.target: given 'examples.push.world'; it is no target",
        ),
        ({"name": "mine", "target": "examples.pull:Pull"}, "there is no module 'examples.pull' on Python's path"),
        ({"name": "mine", "target": "examples.push.world:Pull"}, "module 'examples.push.world' has no 'Pull'"),
        ({"name": "mine", "target": ":Push"}, "world.target: given ':Push'; it is no target"),
        ({"name": "mine", "target": ".world:Push"}, "world.target: given '.world:Push'; it is no target"),
        ({"name": "door", "target": TARGET}, "world.name: given 'door'; it is the name of one that is there already"),
        ({"name": "../mine", "target": TARGET}, "world.name: given '../mine'; it stands in names of folders"),
        ({"name": "mine"}, "world.name: given 'mine'; unknown world 'mine'; known: .*or 'package.module:attribute'"),
    ],
)
def test_what_cannot_be_imported_is_refused(world, message):
    plain = yaml.safe_load((ROOT / "data/config/pick_place/discover.yaml").read_text())
    with pytest.raises(ConfigError, match=message) as caught:
        validate({**plain, "world": world}, SCHEMAS["discover"], "test")
    assert len(str(caught.value).splitlines()) == 2, "one mistake, one complaint"


@pytest.mark.parametrize("file", ["world.py", "skills.py"])
def test_an_edit_of_it_makes_its_rows_and_its_records_another_ones(file, tmp_path, monkeypatch):
    """Neither name, parameters nor sensors show a mass; once an old policy came back after such an edit."""
    shutil.copytree(ROOT / "examples/push", tmp_path / "shove")
    for copy in (tmp_path / "shove").glob("*.py"):
        copy.write_text(copy.read_text().replace("examples.push", "shove"))
    monkeypatch.syspath_prepend(tmp_path)
    plain = yaml.safe_load((ROOT / "data/config/pick_place/discover.yaml").read_text())
    mine = {"name": "mine", "target": "shove.world:Push", "params": {"nthread": 1}}
    cfg = validate({**plain, "world": mine}, SCHEMAS["discover"], "test")

    def identities():
        return cfg.hash, code_of("discover", cfg, tmp_path), make_world(cfg.world.key, cfg.world.params).digest

    before, edited = identities(), tmp_path / "shove" / file
    edited.write_text(edited.read_text() + "\n# Nothing is done here.\n")
    assert identities() == before
    edited.write_text(edited.read_text() + "\nKILOGRAMS = 2.0\n")
    assert not set(identities()) & set(before)


def test_what_a_function_does_to_a_world_is_part_of_its_identity(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    text = "from examples.push.world import Push\ndef make(nthread=1):\n    return Push(nthread=nthread)\n"
    (tmp_path / "made.py").write_text(text)
    before = make_world("made:make").digest
    assert make_world("made:make").digest == before != make_world(TARGET).digest
    (tmp_path / "made.py").write_text(text + "HEIGHT_M = 0.2\n")
    assert make_world("made:make").digest != before


def test_no_stage_depends_on_it():
    stages = sorted(file.stem for file in (ROOT / "stages").glob("[a-z]*.py"))
    files = {file for name in stages for file in closure(f"stages.{name}", {"stages": ROOT / "stages"})}
    assert not [
        file for file in files if not file.is_relative_to(ROOT / "src") and not file.is_relative_to(ROOT / "stages")
    ]
