"""The stage `config`: what it writes is what the stages accept, and nothing is written unless all of it is right."""

import re
import shutil
from pathlib import Path

import pytest
import yaml
from hydra import compose, initialize_config_dir

from p2l.errors import ConfigError
from p2l.schema import SCHEMAS, ChainRecoveriesConfig, ConfigStageConfig, resolve, validate
from p2l.tracking import Tracker
from stages import _chains, _composition, config

ROOT = Path(__file__).resolve().parents[2]
PRESETS = sorted(path.stem for path in (ROOT / "conf" / "experiment").glob("*.yaml"))
DOMAINS = sorted(path.stem for path in (ROOT / "conf" / "domain").glob("*.yaml"))
STAGES = _composition.WORLD_STAGES
WORLDS = sorted(path.stem for path in (ROOT / "conf" / "world").glob("*.yaml"))
CHAINED = ["pick_place", "shelf", "cluttered_shelf", "shelf_ur5e"]
DOORS = [world for world in WORLDS if world.startswith("door")]  # the worlds that have symbols


def configure(out, *words):
    """Run the stage in this process; where worlds are named, all that learn no recoveries are grouped as found."""
    named = {"worlds": ["door", "pick_place", "shelf", "cluttered_shelf"], "recovery_worlds": ["door"]}
    given = dict(word.split("=", 1) for word in words if "worlds=" in word)
    named |= {key: value.strip("[]").split(",") for key, value in given.items()}
    if given and "cluster_worlds" not in given:
        others = dict.fromkeys(name for name in named["worlds"] if name not in named["recovery_worlds"])
        words = (*words, f"cluster_worlds=[{','.join(others)}]")
    with initialize_config_dir(str(ROOT / "conf"), version_base="1.3"):
        cfg = validate(resolve(compose("config", [*words])), ConfigStageConfig, "conf/config.yaml")
        config.run.__wrapped__(cfg, out, Tracker())


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """What the stage writes as the repository stands."""
    out = tmp_path_factory.mktemp("config")
    configure(out)
    return out


@pytest.mark.parametrize("preset", PRESETS)
def test_every_preset_configures_every_stage_of_every_item(tmp_path, preset):
    worlds, doors = f"worlds=[{','.join(WORLDS)}]", f"recovery_worlds=[{','.join(DOORS)}]"
    chained = f"chain_worlds=[{','.join(CHAINED)}]"
    configure(tmp_path, f"preset={preset}", f"domains=[{','.join(DOMAINS)}]", worlds, doors, chained)
    items = {path.relative_to(tmp_path).as_posix() for path in tmp_path.glob("*/*.yaml")}
    of_domains = {f"{domain}/{stage}.yaml" for domain in DOMAINS for stage in _composition.DOMAIN_STAGES}
    of_worlds = {f"{world}/{stage}.yaml" for world in WORLDS for stage in _composition.WORLD_STAGES}
    of_doors = {f"{door}/{stage}.yaml" for door in DOORS for stage in _composition.RECOVERY_STAGES}
    of_chained = {f"{world}/{stage}.yaml" for world in CHAINED for stage in _composition.CHAIN_STAGES}
    assert items == of_domains | of_worlds | of_doors | of_chained | {"report/report.yaml"}
    for path in tmp_path.glob("*/*.yaml"):
        content = yaml.safe_load(path.read_text())
        assert "${" not in path.read_text()
        assert str(ROOT) not in path.read_text()
        assert validate(content, SCHEMAS[path.stem], path.name).model_dump(mode="json") == content


def test_overrides_reach_their_stage_and_removed_items_go(tmp_path, written):
    shutil.copytree(written, tmp_path, dirs_exist_ok=True)
    configure(
        tmp_path, "domains=[lego]", "worlds=[door]", "chain_worlds=[]", "+overrides.plan=['time_limit_s=7.5']", "seed=7"
    )
    assert sorted(path.name for path in tmp_path.iterdir() if path.is_dir()) == ["door", "lego", "report"]
    plan = yaml.safe_load((tmp_path / "lego" / "plan.yaml").read_text())
    assert (plan["time_limit_s"], plan["seed"]) == (7.5, 7)


def test_a_variant_of_a_world_has_folders_of_its_own(tmp_path):
    """A file of `conf/world` is an item; every stage of it reads and writes under the item's name."""
    written = {}
    for item in WORLDS:
        configure(tmp_path, "domains=[lego]", f"worlds=[{item}]", "recovery_worlds=[]", "chain_worlds=[]")
        written[item] = {stage: yaml.safe_load((tmp_path / item / f"{stage}.yaml").read_text()) for stage in STAGES}
    for item, stages in written.items():
        assert stages["discover"]["item"] == item
        assert stages["cluster"]["failures"] == f"data/discover/{item}/failures_train.npz"
        assert stages["cluster"]["held_out"] == f"data/discover/{item}/failures_held_out.npz"
        assert stages["cluster"]["world"] == stages["discover"]["world"]


def test_recoveries_are_learnt_from_the_items_own_files(tmp_path):
    items = "worlds=[door,door_handle2]", "recovery_worlds=[door_handle2]", "chain_worlds=[]"
    configure(tmp_path, "domains=[lego]", *items)
    assert not (tmp_path / "door" / "learn_recoveries.yaml").exists()
    learn = yaml.safe_load((tmp_path / "door_handle2" / "learn_recoveries.yaml").read_text())
    assert learn["preconditions"] == "data/fit_preconditions/door_handle2/preconditions.npz"
    assert learn["modes"] == "data/cluster/door_handle2/modes.npz"
    group = yaml.safe_load((tmp_path / "door_handle2" / "cluster.yaml").read_text())
    assert group["preconditions"] == learn["preconditions"]
    assert yaml.safe_load((tmp_path / "door" / "cluster.yaml").read_text())["preconditions"] is None
    assert learn["failures"] == "data/discover/door_handle2/failures_train.npz"
    assert learn["held_out"] == "data/discover/door_handle2/failures_held_out.npz"


def test_the_pipeline_trains_what_its_preset_compares(tmp_path):
    """A person's run is one learner with one seed; the pipeline's are those of the preset."""
    items = "worlds=[door,pick_place,shelf]", "chain_worlds=[shelf]"
    configure(tmp_path, "preset=thesis", "domains=[lego]", *items, "+overrides.chain_recoveries=['seeds=[3]']")
    assert not (tmp_path / "pick_place" / "chain_recoveries.yaml").exists()
    learn, judge = (
        yaml.safe_load((tmp_path / "shelf" / f"{stage}.yaml").read_text()) for stage in _composition.CHAIN_STAGES
    )
    assert (learn["compare"], learn["seeds"]) == (["rc", "lazy_rc", "pp", "rl", "search", "search_mixed"], [3])
    assert learn["failures"] == "data/discover/shelf/failures_train.npz"
    assert judge["learnt"] == "data/chain_recoveries/shelf"
    assert learn["limits"]["history"] == 3
    cfg = validate(learn, ChainRecoveriesConfig, "")
    runs = {name: _chains.chain_run(cfg, name, 3) for name in ("rc", "rl")}
    assert {name: run.settings.ppo.gae_lambda for name, run in runs.items()} == {"rc": 0.8, "rl": 0.95}
    assert "ppo" not in cfg.alone("rc", 3).model_dump()["learner"], "its hash is that of before"
    assert runs["rl"].settings.ppo.ent_coef == cfg.ppo.ent_coef
    limits = {name: _chains.chain_run(cfg, name, 3).limits for name in ("rc", "search", "search_mixed")}
    assert limits["search_mixed"] == limits["search"]  # of which it is a variant
    every = {name: _chains.chain_run(cfg, name, 3).settings.evaluate_every for name in ("rc", "search")}
    assert every == {"rc": 24_000, "search": 12_000}
    assert "evaluate_every" not in cfg.alone("rc", 3).model_dump()["learner"], "its hash is that of before"
    assert (limits["rc"].history, limits["search"].history) == (3, 1)
    assert "felt_force" in limits["search"].fields
    assert "felt_force" not in limits["rc"].fields
    assert limits["rc"].decisions == limits["search"].decisions
    assert cfg.alone("rc", 3).limits_of == {}  # what another one sees does not make it another run
    assert "arm_rad" not in learn["limits"]["fields"]  # a policy is to mean the same on another arm
    assert {"bottle", "can", "ur5e"} <= set(judge["transfer"]["variants"])
    mixed = learn["learners"]["search_mixed"]["params"]["mixture"]
    assert {params.get("object", "box") for params in mixed.values()} == {
        "box",
        "bottle",
        "can",
        "box_small",
        "box_large",
    }
    assert not any("arm" in params for params in mixed.values())  # transfer to another arm is a transfer


@pytest.mark.parametrize(
    ("word", "part"),
    [
        ("preset=slow", "allowed: quick, smoke, thesis"),
        ("domains=[door]", "door"),
        ("domains=[]", "at least one domain"),
        ("domains=[lego,lego]", "none twice"),
        ("worlds=[door,door]", "none twice"),
        ("worlds=[doors]", "doors"),
        ("worlds=[shelf]", "recovery_worlds names door; worlds has: shelf"),
        ("worlds=[door]", "chain_worlds names pick_place, shelf; worlds has: door"),
        ("chain_worlds=[shelf,shelf]", "chain_worlds names a world twice"),
        ("chain_worlds=[ant]", "chain_worlds names ant; worlds has: door, pick_place"),
        ("+overrides.chain_recoveries=['compare=[sac]']", "compare names sac; learners has: rc, lazy_rc, pp, rl, "),
        (
            "+overrides.chain_recoveries=['+learners.rl.ppo.gae_lamda=0.9']",
            "learners.rl.ppo.gae_lamda: given 0.9; Extra inputs are not permitted; its keys are n_steps, ",
        ),
        ("+overrides.chain_recoveries=['+learners.search.ppo.gamma=0.9']", "learners.search.ppo.gamma: the search "),
        ("+overrides.chain_recoveries=['learners.rl.ppo.gae_lambda=2']", "learners.rl.ppo.gae_lambda: given 2; "),
        ("recovery_worlds=[door,door]", "recovery_worlds names a world twice"),
        ("recovery_worlds=[shelf]", "has no symbols, so no skill graph; give it a method"),
        ("cluster_worlds=[shelf,door,pick_place,cluttered_shelf]", "cluster_worlds and recovery_worlds both name door"),
        ("cluster_worlds=[shelf]", "neither cluster_worlds nor recovery_worlds names pick_place, cluttered_shelf"),
        ("+overrides.discover=['strategy=optimistic']", "strategy: given 'optimistic'"),
        ("+overrides.cluster=['video.width=33']", "video.width: given '33'"),
        ("+overrides.plan=['gap=-1']", "gap: given '-1'"),
        ("+overrides.plan=['gep=1']", "gep"),
        ("+overrides.plan=['planner=greedy']", "planner: only for your own tasks"),
        ("+overrides.bake=['gap=1']", "bake"),
    ],
)
def test_a_mistake_leaves_the_old_files_alone(written, word, part):
    before = {path: path.read_text() for path in written.glob("*/*.yaml")}
    with pytest.raises(ConfigError, match=re.escape(part)):
        configure(written, word)
    assert {path: path.read_text() for path in written.glob("*/*.yaml")} == before
