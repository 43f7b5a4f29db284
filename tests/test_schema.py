"""Configurations: every wrong key is named in one message, and nothing wrong gets through."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf
from pydantic import ValidationError

from p2l.errors import ConfigError
from p2l.schema import SCHEMAS, CollectConfig, resolve, validate
from p2l.schema.recovery import WorldConfig, WorldStageConfig

GOOD = {"seed": 0, "domain": {"name": "lego", "params": {}}, "n_tasks": 30, "n_taught": 10, "draws": 4}
NUMBERS = st.integers(-5, 40) | st.floats() | st.text(max_size=3) | st.none() | st.lists(st.integers(), max_size=2)


def collect(**changes):
    return validate({**GOOD, **changes}, CollectConfig, "test")


def is_count(value):
    return isinstance(value, int) and value >= 1


@given(NUMBERS)
def test_draws_are_a_count_or_refused_by_name(draws):
    if is_count(draws):
        assert collect(draws=draws).draws == draws
    else:
        with pytest.raises(ConfigError, match="draws: given"):
            collect(draws=draws)


@given(st.text(min_size=1).filter(lambda key: key not in CollectConfig.model_fields))
def test_an_unknown_key_is_refused_with_those_allowed(key):
    with pytest.raises(ConfigError, match="unknown key") as caught:
        collect(**{key: 1})
    assert "allowed: domain, draws, n_tasks, n_taught, records, seed, tracking" in str(caught.value)


@given(st.sampled_from(sorted(GOOD)), st.integers(-3, 50), st.integers(-3, 50))
def test_what_is_accepted_obeys_the_rules(missing, n_tasks, n_taught):
    if 1 <= n_taught <= n_tasks:
        assert collect(n_tasks=n_tasks, n_taught=n_taught).n_taught == n_taught
    else:
        with pytest.raises(ConfigError, match="n_ta"):
            collect(n_tasks=n_tasks, n_taught=n_taught)
    if missing != "seed":
        with pytest.raises(ConfigError, match=f"{missing}: missing"):
            validate({key: value for key, value in GOOD.items() if key != missing}, CollectConfig, "test")


def test_all_mistakes_come_in_one_message():
    with pytest.raises(ConfigError) as caught:
        collect(seed=-1, draws=0, domain={"name": "door", "parms": {}})
    for part in ("seed: given '-1'", "draws: given '0'", "domain.name: given 'door'", "did you mean 'params'", "lego"):
        assert part in str(caught.value)


def test_a_configuration_cannot_be_changed():
    with pytest.raises(ValidationError, match="frozen"):
        collect().draws = 5


def test_the_hash_sees_the_work_and_not_the_tracking():
    assert collect().hash == collect(tracking={"enabled": False}).hash
    assert len({collect().hash, collect(seed=1).hash, collect(draws=5).hash}) == 3


def test_own_tasks_need_both_files():
    plain = {**GOOD, "tasks": "orders.csv", "transfer": None}
    with pytest.raises(ConfigError, match="transfer is missing; give tasks="):
        validate(plan_fields(plain), SCHEMAS["plan"], "test")
    own = validate(plan_fields({**plain, "transfer": "transfer.csv"}), SCHEMAS["plan"], "test")
    assert (own.subject, own.tasks) == ("orders", Path("orders.csv"))


def plan_fields(changes):
    """A valid `plan` configuration as composed by Hydra, with changes."""
    from hydra import compose, initialize_config_dir

    with initialize_config_dir(str(Path(__file__).resolve().parents[1] / "conf"), version_base="1.3"):
        plain = resolve(compose("plan", ["domain=lego"]))
    return plain | {key: changes[key] for key in ("tasks", "transfer")}


def test_the_table_of_budgets_is_used_up():
    composed = OmegaConf.create(
        {"experiment": {"lego": {"draws": 4}}, "name": "lego", "draws": "${experiment.${name}.draws}"}
    )
    assert resolve(composed) == {"name": "lego", "draws": 4}


@pytest.mark.parametrize("value", ["${experiment.nowhere}", "???", "${oc.unknown:x}"])
def test_a_value_that_cannot_be_resolved_names_its_key(value):
    with pytest.raises(ConfigError, match="draws"):
        resolve(OmegaConf.create({"experiment": {}, "draws": value}))


def test_the_hash_does_not_see_how_many_threads_simulate():
    def work(**params):
        return WorldStageConfig(item="shelf", world=WorldConfig(name="shelf", params=params)).hash

    assert work(arm="Panda") == work(arm="Panda", nthread=1) != work(arm="IIWA")
