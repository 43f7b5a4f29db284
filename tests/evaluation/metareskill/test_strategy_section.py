"""Chapter 4's sections over tables made by hand: headline numbers, agreement with the thesis, and worlds left out."""

import numpy as np
import pandas as pd
import pytest

from p2l.errors import ArtifactError
from p2l.evaluation.metareskill import strategies
from p2l.evaluation.metareskill.curves import figure_4_6, figure_4_7
from p2l.evaluation.metareskill.tables import table_4_1, table_4_2
from p2l.evaluation.metareskill.within import success_within
from p2l.evaluation.page.page import Picture, Reading, render
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.thesis import load_thesis
from tests.sealing import seal

THESIS = "data/thesis"


def episodes(method, successes, setting="", count=40):
    place = np.arange(count)
    rows = {"episode": place, "success": place < successes, "diverged": False, "path_m": 0.5, "options": 3}
    return pd.DataFrame(rows).assign(recoveries=0, place="door", setting=setting, method=method, seed=0)


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    data, thesis, rng = tmp_path_factory.mktemp("data"), load_thesis(THESIS, 4), np.random.default_rng(0)
    compared = pd.concat([episodes("recoveries", 38), episodes("retry", 38), episodes("open_loop", 20)])
    doors = pd.concat([episodes("recoveries", 30, "handle=2"), episodes("open_loop", 34, "handle=2")])
    curves = {"metareskill": [-10.0, -4.0], "round_robin": [-10.0, -6.0]}
    values = [(0, name, k, value) for name, curve in curves.items() for k, value in enumerate(curve)]
    values = pd.DataFrame(values, columns=["seed", "chooser", "queries", "value"])
    allocation = [(0, name, 0, "goal", 1, 0.5) for name in curves]
    allocation = pd.DataFrame(allocation, columns=["seed", "chooser", "mode", "target", "trained", "q"])
    tables = {
        "table_4_1": table_4_1(compared, thesis, rng),
        "table_4_2": table_4_2(doors, ["handle=2"], thesis, rng),
        "figure_4_6": figure_4_6(values, allocation, list(curves), thesis),
        "figure_4_7": figure_4_7(values, "metareskill", thesis),
        "success_within": success_within(compared, thesis),
    }
    folder = data / "evaluate_recoveries" / "door"
    folder.mkdir(parents=True)
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False)
        (folder / f"{name}.png").write_bytes(b"a picture")
    return Sources(seal(data), THESIS, (), ("door",), ("door",))


def reading(section):
    [found] = [part for part in section.parts if isinstance(part, Reading)]
    return found


def test_strategies_agree_with_the_thesis_only_where_every_gain_is_clear(made):
    section = strategies.table_4_1(made)
    assert section.metrics["table_4_1/door/recoveries/success"] == 0.95
    assert section.metrics["table_4_1/door/recoveries/over_open_loop/gain"] == pytest.approx(0.45)
    assert reading(section).agrees == "partly"  # as often as retry
    assert "+45.0" in reading(section).ours
    assert "evaluate_recoveries" in section.commands[-1]
    assert [sheet.name for sheet in section.sheets] == ["table_4_1"]


def test_success_within_so_many_skills_has_a_figure_and_its_table(made):
    section = strategies.within(made)
    assert [part.name for part in section.parts if isinstance(part, Picture)] == ["success_within"]
    [sheet] = section.sheets
    assert [row[:4] for row in sheet.rows][:3] == [
        ["recoveries", str(count), "success within skills", f"{rate} %"]
        for count, rate in ((1, "0.0 [0.0, 8.8]"), (2, "0.0 [0.0, 8.8]"), (3, "95.0 [83.5, 98.6]"))
    ]


def test_a_loss_on_unseen_handles_differs_from_the_thesis(made):
    section = strategies.table_4_2(made)
    assert reading(section).agrees == "no"
    assert section.metrics["table_4_2/door/recoveries/over_open_loop/handle_unseen/gain"] == pytest.approx(-0.1)


def test_figures_come_with_their_tables(made):
    section = strategies.curves(made)
    assert [part.name for part in section.parts if isinstance(part, Picture)] == ["figure_4_6", "figure_4_7"]
    assert {sheet.name for sheet in section.sheets} == {"figure_4_6", "figure_4_7"}
    assert reading(section).agrees == "yes"
    assert "metareskill" in render("title", ["about"], [section])


def test_left_out_or_missing_is_said(made, tmp_path):
    for section in (strategies.table_4_1, strategies.within, strategies.table_4_2, strategies.curves):
        assert "Left out" in section(Sources(made.data, THESIS, (), ("door",))).parts[0]
    with pytest.raises(ArtifactError, match="dvc repro evaluate_recoveries"):
        strategies.table_4_1(Sources(tmp_path, THESIS, (), ("door",), ("door",)))
