"""How policies act, on sequences made by hand."""

import pandas as pd
import pytest

from p2l.evaluation.chaining.ablation import OWN, ablation_5, open_loop, primitives
from p2l.evaluation.thesis import load_thesis


def test_one_sequence_after_every_failure_is_open_loop():
    assert open_loop(pd.Series(["move +z;from place"] * 3)) == 1.0
    # Two of three agree on the first decision, two of two on the second.
    assert open_loop(pd.Series(["move +z;from place", "move +z;from place", "from pick"])) == 4 / 5


def test_what_hands_over_is_no_primitive():
    assert primitives(pd.Series(["move +z;turn -z;from place", "from pick", "move +z"])) == pytest.approx(1.0)


def test_without_another_variant_there_is_nothing_to_compare():
    columns = ["learner", "whole_task", "seed", "nominal", "flagged", "success", "diverged", "actions"]
    none = pd.DataFrame(columns=columns)
    assert len(ablation_5("shelf", {OWN: none}, load_thesis("data/thesis", 5))) == 0
    one = pd.DataFrame([("rc", False, 0, False, True, True, False, "from pick")], columns=columns)
    table = ablation_5("shelf", {OWN: one, "double": one}, load_thesis("data/thesis", 5))
    assert table.groupby("metric")["mean"].first().to_dict() == {
        "nominal": 0.0, "success": 1.0, "recovery": 1.0, "primitives": 0.0, "open_loop": 1.0
    }  # fmt: skip
