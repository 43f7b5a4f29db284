import numpy as np
import pandas as pd
import pytest

from p2l.domains.table import make_domain
from p2l.errors import ConfigError
from p2l.ledger import Item, find, write
from p2l.team.execute import Truth, execute_plans, predicted_plans, recorded_rows, recorded_truth, true_plans
from p2l.team.study import Regime, Study, make_block, make_problem, task_sets, tune_theta

HIGH = Regime("high", 10.0, 100.0, 100.0, 200.0, (0, 2))
STUDY = Study((HIGH,), sets=4, set_size=5, blocks=2, pool=8, pretrained_pool=3, draws=2, tuning_sets=3, theta=0.5)


@pytest.fixture(scope="module")
def lego():
    return make_domain("lego")


def overlap(taught, tested):
    """A stand-in for a fitted predictor: a smooth function of the features."""
    return np.exp(-0.1 * np.abs(taught[:, None] - tested[None]).sum(-1))


def test_sets_are_spread_over_blocks_and_repeat_with_the_seed(lego):
    blocks = [make_block(lego, STUDY, 0, index) for index in range(2)]
    sets = [task_sets(STUDY, 0, block) for block in blocks]
    assert [task_set.index for block in sets for task_set in block] == [0, 2, 1, 3]
    for task_set in sets[0]:
        assert len(set(task_set.tasks.tolist())) == 5
        assert sorted(task_set.pretrained.tolist()) == [0, 1, 2]
    assert blocks[0].digest != blocks[1].digest
    assert make_block(lego, STUDY, 0, 1).digest == blocks[1].digest
    assert make_block(lego, STUDY, 1, 1).digest != blocks[1].digest


def test_orders_are_found_by_name():
    domain = make_domain("board", {"physics": {"tip": "peg"}})
    orders = (("1", "3", "2", "12"), ("0", "1", "2", "14"))
    study = Study((HIGH,), 2, 4, 1, 17, 2, 1, 1, 0.5, orders)
    block = make_block(domain, study, 0, 0)
    found = [tuple(block.pool.names[index] for index in task_set.tasks) for task_set in task_sets(study, 0, block)]
    assert tuple(found) == orders
    wrong = Study((HIGH,), 1, 4, 1, 17, 2, 1, 1, 0.5, (("1", "3", "2", "17"),))
    with pytest.raises(ConfigError, match=r"unknown tasks \['17'\]"):
        task_sets(wrong, 0, block)


def test_pretrained_skills_enter_a_problem_as_the_best_of_them(lego):
    tasks = lego.sample_set(np.random.default_rng(0), 3)
    known = np.array([[0.1, 0.9, 0.2], [0.5, 0.3, 0.2]])
    problem, skill = make_problem(HIGH, tasks, np.eye(3), known)
    np.testing.assert_array_equal(problem.pretrained, [0.5, 0.9, 0.2])
    np.testing.assert_array_equal(skill, [1, 0, 0])
    problem, skill = make_problem(HIGH, tasks, np.eye(3), np.zeros((0, 3)))
    np.testing.assert_array_equal(problem.pretrained, 0.0)
    np.testing.assert_array_equal(skill, -1)


def test_executed_cost_by_hand():
    """Teach task 0, attempt 1 with its skill (true rate 0.6), delegate 2, attempt 3 with pre-trained skill 4 (0.25)."""
    executing = np.zeros((5, 4))
    executing[0, 1], executing[4, 3] = 0.6, 0.25
    plans = pd.DataFrame(
        {
            "block": 0,
            "set": 0,
            "regime": "high",
            "level": 1,
            "method": "adl",
            "step": range(4),
            "task": range(4),
            "name": list("abcd"),
            "decision": ["learn", "act", "delegate", "act"],
            "skill": [0, 0, -1, 4],
            "p_success": [1.0, 0.9, 1.0, 0.5],
            "predicted_cost": [200.0, 20.0, 100.0, 60.0],
        }
    )
    [row] = execute_plans(plans, (HIGH,), Truth(np.zeros((5, 4)), executing)).to_dict("records")
    assert row["executed_cost"] == pytest.approx(200 + (10 + 40) + 100 + (10 + 75))
    assert row["predicted_cost"] == 380.0
    assert (row["demos"], row["delegated"], row["attempts"], row["n_tasks"]) == (1, 1, 2, 4)
    assert row["failures"] == pytest.approx(0.4 + 0.75)


def test_an_attempt_without_any_skill_fails(lego):
    block = make_block(lego, STUDY, 0, 0)
    plans = predicted_plans(STUDY, 0, block, lambda a, b: np.zeros((len(a), len(b))), {"high": 0.5}, 10.0)
    alm = plans[(plans["method"] == "alm") & (plans["level"] == 0)]
    assert (alm["decision"] == "act").all()
    assert (alm["skill"] == -1).all()
    rows = execute_plans(alm, (HIGH,), Truth(np.ones((11, 8)), np.ones((11, 8))))
    np.testing.assert_array_equal(rows["executed_cost"], 5 * 110.0)


def test_with_the_true_matrix_as_prediction_the_plan_costs_what_it_says(lego):
    """When prediction and execution are the same numbers, predicted cost = executed cost, and ADL is the cheapest."""
    block = make_block(lego, STUDY, 0, 1)
    rates = np.random.default_rng(3).random((11, 8))
    both = [predicted_plans(STUDY, 0, block, _Lookup(block, rates), {"high": 0.3}, 10.0)]
    both.append(true_plans(STUDY, 0, block, Truth(rates, rates), 10.0))
    rows = execute_plans(pd.concat(both), (HIGH,), Truth(rates, rates))
    np.testing.assert_allclose(rows["executed_cost"], rows["predicted_cost"])
    costs = rows.pivot_table(index=["set", "level"], columns="method", values="executed_cost")
    for method in ("ad", "cba", "cba_best", "alm"):
        assert (costs["adl"] <= costs[method] + 1e-9).all()
    np.testing.assert_allclose(costs["adl_true"], costs["adl"])
    assert (costs["adl_any"] <= costs["adl"] + 1e-9).all()


class _Lookup:
    """A predictor that knows the table: rows and columns are found by their features."""

    def __init__(self, block, rates):
        self.block, self.rates = block, rates

    def __call__(self, taught, tested):
        pool = [features.tobytes() for features in self.block.pool.features]
        rows = pool + [features.tobytes() for features in self.block.pretrained.features]
        return self.rates[np.ix_([rows.index(x.tobytes()) for x in taught], [pool.index(x.tobytes()) for x in tested])]


def test_the_ledger_spares_what_is_done(lego, tmp_path):
    block = make_block(lego, STUDY, 0, 0)
    first = recorded_truth(lego, STUDY, 0, block, tmp_path, "abc")
    assert first.executing.shape == (11, 8)
    # The record is the proof that nothing ran again: what it says is what comes back.
    item = Item("lego", "truth", 0, 0, _hash_of(tmp_path / "lego-truth-s0-b0.json"))
    marked = {"planning": np.zeros((11, 8)).tolist(), "executing": np.full((11, 8), 0.5).tolist()}
    write(tmp_path, item, marked, seconds=1.0)
    assert (recorded_truth(lego, STUDY, 0, block, tmp_path, "abc").executing == 0.5).all()
    assert (recorded_truth(lego, STUDY, 0, block, tmp_path, "other").executing == first.executing).all()
    plans = true_plans(STUDY, 0, block, first, 10.0)
    rows = recorded_rows(lego, STUDY, 0, plans, first, tmp_path)
    assert rows == recorded_rows(lego, STUDY, 0, plans, first, tmp_path)
    # Another processor predicts the same to the last bit but one, and decides the same.
    elsewhere = plans.assign(
        p_success=np.nextafter(plans["p_success"], 0.5), predicted_cost=plans["predicted_cost"] + 1e-12
    )
    assert rows == recorded_rows(lego, STUDY, 0, elsewhere, first, tmp_path)
    assert (tmp_path / "lego-adl_true-s0-b0.json").is_file()


def test_a_damaged_or_foreign_record_is_not_used(tmp_path):
    item = Item("lego", "adl", 3, 0, "hash")
    assert find(tmp_path, item) is None
    write(tmp_path, item, {"rows": [1]}, seconds=0.1)
    assert find(tmp_path, item) == {"rows": [1]}
    assert find(tmp_path, Item("lego", "adl", 3, 0, "other")) is None
    file = tmp_path / item.file
    file.write_text(file.read_text().replace("1\n", "2\n", 1))
    assert find(tmp_path, item) is None


def _hash_of(path):
    import json

    return json.loads(path.read_text())["config_hash"]


def test_theta_is_tuned_on_other_tasks(lego):
    tasks = lego.sample_tasks(np.random.default_rng(5), 40)
    theta = tune_theta(STUDY, HIGH, tasks, overlap, seed=0)
    assert 0.0 <= theta <= 1.0
    assert theta == tune_theta(STUDY, HIGH, tasks, overlap, seed=0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"orders": (("a",),)}, "orders need 1"),
        ({"pretrained_pool": 1}, "level 2"),
        ({"pool": 4}, "set_size 5"),
        ({"blocks": 9}, "blocks is 9"),
    ],
)
def test_impossible_studies_are_refused(change, message):
    with pytest.raises(ConfigError, match=message):
        Study(**{**STUDY.__dict__, **change})
