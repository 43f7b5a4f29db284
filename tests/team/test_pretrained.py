"""What the robot can do today, measured before a plan is made: with draws of its own, recorded, and used by plans."""

import json

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_array_equal

from p2l.domains.table import make_domain
from p2l.errors import ConfigError
from p2l.ledger import Item, find, write
from p2l.records import TransferData
from p2l.schema import SCHEMAS, validate
from p2l.seeding import generator
from p2l.team.execute import measure_truth, predicted_plans, recorded_truth, study_plans
from p2l.team.items import recorded
from p2l.team.pretrained import learn_block, measure_pretrained, measurement, recorded_pretrained, recorded_skills
from p2l.team.study import Regime, Study, make_block

HIGH = Regime("high", 10.0, 100.0, 100.0, 200.0, (0, 2))
STUDY = Study(
    (HIGH,),
    sets=2,
    set_size=4,
    blocks=1,
    pool=5,
    pretrained_pool=2,
    draws=3,
    tuning_sets=2,
    theta=0.5,
    pretrained_draws=4,
)


@pytest.fixture(scope="module")
def lego():
    return make_domain("lego", {"candidates": 2000})


@pytest.fixture(scope="module")
def block(lego):
    return make_block(lego, STUDY, 0, 0)


@pytest.fixture(scope="module")
def skills(lego, block):
    return learn_block(lego, 0, block)


def nothing(taught, tested):
    """A predictor that believes in no skill."""
    return np.zeros((len(taught), len(tested)))


def test_only_skills_that_the_robot_has_are_tried_and_on_today_s_tasks(lego, block, skills):
    rate = measure_pretrained(lego, STUDY, 0, block, skills)
    assert rate.shape == (2, 5)
    assert_array_equal(rate * 4, np.round(rate * 4))
    rng = generator(0, "plan", "lego", "pretrained", 0)
    again = lego.evaluate(skills[5:], block.pretrained, block.pool, 4, rng)
    assert_array_equal(rate, again.mean(-1))


class _Watched:
    """A domain that notes the state of every generator that it is evaluated with."""

    def __init__(self, domain):
        self.domain, self.seen = domain, []

    def __getattr__(self, name):
        return getattr(self.domain, name)

    def evaluate(self, skills, learnt_on, tasks, draws, rng, progress=None):
        self.seen.append(rng.bit_generator.state["state"]["state"])
        return self.domain.evaluate(skills, learnt_on, tasks, draws, rng, progress)


def test_measuring_and_judging_meet_other_draws(lego, block, skills):
    watched = _Watched(lego)
    measure_pretrained(watched, STUDY, 0, block, skills)
    truth = measure_truth(watched, STUDY, 0, block, skills=skills)
    assert len(set(watched.seen)) == 2
    assert truth.executing.shape == (7, 5)


def test_measured_rates_are_what_plans_believe_of_pretrained_skills_and_lessons_stay_predicted(block):
    """No lesson is believed to help; skill 1 does everything: the robot attempts all with it at level 2."""
    library = np.array([[0.1] * 5, [0.9] * 5])
    plans = predicted_plans(STUDY, 0, block, nothing, {"high": 0.5}, 10.0, library)
    adl = plans[plans["method"] == "adl"]
    assert (adl.loc[adl["level"] == 2, "decision"] == "act").all()
    assert (adl.loc[adl["level"] == 2, "skill"] == 5 + 1).all()
    np.testing.assert_allclose(adl.loc[adl["level"] == 2, "p_success"], 0.9)
    assert (adl.loc[adl["level"] == 0, "decision"] == "delegate").all()
    without = predicted_plans(STUDY, 0, block, nothing, {"high": 0.5}, 10.0)
    assert (without.loc[without["method"] == "adl", "decision"] == "delegate").all()


def test_a_study_measures_its_blocks_by_the_record(lego, block, tmp_path):
    collected = TransferData(
        block.pool.names, block.pool.features, lego.feature_names, block.pool.group, [0], np.zeros((1, 5)), 1, [[0.0]]
    )
    study = Study(**{**STUDY.__dict__, "set_size": 3})
    arguments = lego, study, 0, collected, nothing, 10.0
    thetas, plans = study_plans(*arguments, measurement(lego, study, 0, tmp_path, "abc"))
    rate = recorded_pretrained(lego, study, 0, block, tmp_path, "abc")
    mine = plans[(plans["method"] == "adl") & (plans["level"] == 2) & (plans["decision"] == "act")]
    for row in mine.to_dict("records"):
        assert row["p_success"] == rate[row["skill"] - 5, row["task"]]
    assert len(mine) > 0
    assert thetas == study_plans(*arguments)[0]


def test_records_spare_learning_and_hold_the_very_skills(lego, block, skills, tmp_path):
    recorded_pretrained(lego, STUDY, 0, block, tmp_path, "abc")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["lego-pretrained-s0-b0.json", "lego-skills-s0-b0.json"]
    assert_array_equal(recorded_skills(lego, 0, block, tmp_path, "abc"), skills)  # NaN where a skill is shorter
    assert recorded_skills(lego, 0, block, tmp_path, "other") is None
    # Records are the proof that nothing was made again: what they say is what is used.
    others = skills[::-1]
    mark(tmp_path, "skills", {"skills": [[None if np.isnan(x) else x for x in row] for row in others.tolist()]})
    mark(tmp_path, "pretrained", {"rate": np.full((2, 5), 0.5).tolist(), "executions": 40})
    assert_array_equal(recorded_pretrained(lego, STUDY, 0, block, tmp_path, "abc"), 0.5)
    more = Study(**{**STUDY.__dict__, "pretrained_draws": 5})
    tried = recorded_pretrained(lego, more, 0, block, tmp_path, "abc")
    assert_array_equal(tried, measure_pretrained(lego, more, 0, block, others))
    truth = recorded_truth(lego, STUDY, 0, block, tmp_path, "abc")
    assert_array_equal(truth.executing, measure_truth(lego, STUDY, 0, block, skills=others).executing)


def mark(folder, method, content):
    """Another content in a record of block 0."""
    item = Item("lego", method, 0, 0, json.loads((folder / f"lego-{method}-s0-b0.json").read_text())["config_hash"])
    write(folder, item, content, seconds=1.0)


def test_truth_is_the_same_whether_skills_were_kept_or_not(lego, block, skills, tmp_path):
    kept = measure_truth(lego, STUDY, 0, block, skills=skills)
    pd.testing.assert_frame_equal(
        pd.DataFrame(kept.executing), pd.DataFrame(recorded_truth(lego, STUDY, 0, block, tmp_path, "x").executing)
    )


def test_the_cost_of_measuring_is_told():
    assert STUDY.executions == {"pretrained_executions": 1 * 2 * 5 * 4}
    assert Study(**{**STUDY.__dict__, "pretrained_draws": 0}).executions == {}


def plan_config(**changes):
    """A plan's configuration as the stage sees it."""
    regime = {"c_rob": 10, "c_hum": 100, "c_fail": 100, "c_demo": 200, "levels": [0, 2]}
    study = {key: value for key, value in STUDY.__dict__.items() if key != "regimes"} | {"regimes": {"high": regime}}
    values = {
        "domain": {"name": "insertion", "params": {}},
        "study": study,
        "tasks": None,
        "transfer": None,
        "transfer_model": "m",
        "transfer_data": "d",
        "records": None,
        "planner": "auto",
        "order": None,
        "time_limit_s": 1,
        "gap": 0,
        "theta": 0.5,
    }
    return validate(values | changes, SCHEMAS["plan"], "test")


def test_neither_encoding_nor_measuring_decides_the_truth():
    """Records of truths that were made before there was a choice stay valid."""
    plain = plan_config()
    walls = plan_config(domain={"name": "insertion", "params": {"encoding": "walls"}})
    assert walls.identity == plain.identity
    assert walls.hash == plain.hash
    assert plan_config(domain={"name": "insertion", "params": {"layout_seed": 1}}).identity != plain.identity
    predicted = {**plain.study.model_dump(), "pretrained_draws": 0}
    assert plan_config(study=predicted).identity == plain.identity
    with pytest.raises(ConfigError, match="pretrained_draws"):
        plan_config(study={**predicted, "pretrained_draws": -1})


def test_what_has_a_record_is_not_made_again(tmp_path):
    item, made = Item("lego", "truth", 0, 0, "one"), []

    def make():
        made.append(0)
        return {"value": len(made)}

    assert [recorded(tmp_path, item, make) for _ in range(3)] == [{"value": 1}] * 3
    assert len(made) == 1
    assert find(tmp_path, item) == {"value": 1}
