import numpy as np
import pandas as pd
import pytest

from p2l.evaluation.objective import POLICY, SKILLS, TEAM, Prices, of_policies, of_skills, of_team
from p2l.evaluation.rows import table_of

PRICES = Prices(failure=100.0, query=2.0, control_step=0.01, tasks=10.0)


def values(rows, maker, setting):
    table = table_of(rows)
    own = table[(table["method"] == maker) & (table["setting"] == setting)].set_index("metric")
    return own["mean"].to_dict(), own


def test_the_team_pays_its_demonstrations_and_is_judged_against_teaching_nothing():
    rows = [
        {"set": k, "method": method, "executed_cost": cost, "demos": demos, "n_tasks": 5.0}
        for k, (without, total, number) in enumerate([(1000.0, 700.0, 1.0), (900.0, 700.0, 3.0)])
        for method, cost, demos in (("ad", without, 0.0), ("adl", total, number))
    ]
    mean, table = values(of_team(pd.DataFrame(rows), "domain=a", 100.0), TEAM, "domain=a")
    assert mean["without"] == 950.0
    assert mean["with"] == 500.0  # 700 - 100 and 700 - 300
    assert mean["gain"] == 450.0
    assert mean["learning_cost"] == 200.0
    assert mean["net"] == 250.0
    assert mean["demonstrations"] == 2.0
    assert mean["pays_after"] == pytest.approx(5.0 * 200.0 / 450.0)
    assert table.loc["net", "low"] < 250.0 < table.loc["net", "high"]


def test_recovery_skills_are_judged_against_carrying_on_and_against_the_best_heuristic():
    success = {"recoveries": 0.9, "open_loop": 0.5, "retry": 0.95}
    rows = [(name, "", "success", rate, rate - 0.01, rate + 0.01, 5) for name, rate in success.items()]
    rows += [("recoveries", "over=open_loop", "gain", 0.4, 0.3, 0.5, 200)]
    rows += [("recoveries", "over=retry", "gain", -0.05, -0.1, 0.0, 200)]
    made = of_skills(table_of(rows), "door", [30, 50], PRICES)
    mean, table = values(made, SKILLS, "world=door;instead=open_loop")
    assert mean["without"] == pytest.approx(500.0)
    assert mean["with"] == pytest.approx(100.0)
    assert mean["gain"] == pytest.approx(400.0)
    assert mean["learning_cost"] == 80.0
    assert mean["net"] == pytest.approx(320.0)
    assert table.loc["net", ["low", "high"]].tolist() == pytest.approx([220.0, 420.0])
    assert mean["pays_after"] == pytest.approx(2.0)
    mean, _ = values(made, SKILLS, "world=door;instead=retry")
    assert mean["net"] == pytest.approx(-130.0)
    assert mean["pays_after"] == np.inf


def test_a_recovery_policy_is_paired_by_training_with_the_nominal_skills():
    success = pd.DataFrame({"rc": [0.9, 0.8], "nominal": [0.5, 0.6]})
    mean, table = values(of_policies(success, "shelf", [1000.0, 3000.0], PRICES), POLICY, "world=shelf;instead=nominal")
    assert mean["gain"] == pytest.approx(300.0)
    assert mean["control_steps"] == 2000.0
    assert mean["learning_cost"] == pytest.approx(20.0)
    assert mean["net"] == pytest.approx(280.0)
    assert mean["with"] == pytest.approx(150.0)
    assert table.loc["gain", "n"] == 2


def test_gain_and_net_are_differences_of_what_stands_beside_them():
    success = pd.DataFrame({"rc": [0.9, 0.8, 0.7], "nominal": [0.5, 0.6, 0.9]})
    mean, _ = values(of_policies(success, "shelf", [10.0, 20.0, 30.0], PRICES), POLICY, "world=shelf;instead=nominal")
    assert mean["gain"] == pytest.approx(mean["without"] - mean["with"])
    assert mean["net"] == pytest.approx(mean["gain"] - mean["learning_cost"])
