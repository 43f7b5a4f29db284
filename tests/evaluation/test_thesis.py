"""The thesis's numbers as data: complete, and refused when damaged."""

import pandas as pd
import pytest

from p2l.errors import InputError
from p2l.evaluation.thesis import load_thesis
from tests.evaluation.team.team_results import FOLDER


def test_table_3_2_of_the_thesis_adds_up():
    thesis = load_thesis(FOLDER, 3)
    costs = {"attempts": 10.0, "failures": 100.0, "delegated": 100.0, "demos": 200.0}
    for method in ("adl", "ad", "cba", "alm"):
        counts = {name: thesis.value("table_3_2", method, "pretrained=0", name) for name in list(costs)[1:]}
        counts["attempts"] = 10.0 - counts["demos"] - counts["delegated"]
        total = sum(price * counts[name] for name, price in costs.items())
        assert thesis.value("table_3_2", method, "pretrained=0", "executed_cost") == pytest.approx(total, abs=5.0)


def test_percentages_of_the_caption_follow_from_the_costs():
    thesis = load_thesis(FOLDER, 3)
    cost = {m: thesis.value("table_3_2", m, "pretrained=0", "executed_cost") for m in ("adl", "ad", "cba", "alm")}
    for method in ("ad", "cba", "alm"):
        percent = thesis.value("table_3_2", method, "pretrained=0", "percent_over_adl")
        assert percent == pytest.approx(100 * (cost[method] / cost["adl"] - 1), abs=0.06)


def test_a_table_gets_the_numbers_of_its_own_item_and_nan_elsewhere():
    rows = [("adl", "order=4", "delegated", 0.0), ("adl", "order=4", "executed_cost", 0.0)]
    table = pd.DataFrame(rows, columns=["method", "setting", "metric", "mean"])
    found = load_thesis(FOLDER, 3).beside(table, "table_3_1")["thesis"]
    assert found.iloc[0] == 4.0
    assert pd.isna(found.iloc[1])
    assert load_thesis(FOLDER, 3).value("table_3_1", "ad", "order=4", "delegated") is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("item,method,setting,metric\n", "expected item, method, setting, metric, value"),
        ("item,method,setting,metric,value\na,b,c,d,many\n", "row 2, column 'value': given 'many'"),
        (None, "cannot be read"),
    ],
)
def test_damaged_numbers_are_refused(tmp_path, text, message):
    (tmp_path / "chapter3_claims.csv").write_text("item,claim,text\n")
    if text is not None:
        (tmp_path / "chapter3.csv").write_text(text)
    with pytest.raises(InputError, match=message):
        load_thesis(tmp_path, 3)
