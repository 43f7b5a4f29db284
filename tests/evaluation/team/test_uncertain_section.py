"""Sections over the committed tables: what they say is what the tables hold, and their links lead somewhere."""

import re
from pathlib import Path

import pandas as pd
import pytest

from p2l.errors import ArtifactError
from p2l.evaluation.page.files import save_report
from p2l.evaluation.page.page import Link
from p2l.evaluation.page.sources import Sources
from p2l.evaluation.team.uncertain_section import SECTIONS, preferences, replanning, tomorrow

ROOT = Path(__file__).resolve().parents[3]
COMMITTED = ROOT / "results/thesis/tables"


def sources(results):
    return Sources(ROOT / "absent", ROOT / "absent", (), results=results)


def case(method, metric, mean, reach, setting):
    return (method, setting, metric, mean, mean - reach, mean + reach, 16, None)


def table(folder, name, rows, columns="method,setting,metric,mean,low,high,n,thesis"):
    pd.DataFrame(rows, columns=columns.split(",")).to_csv(folder / f"{name}.csv", index=False)


def test_cases_whose_interval_excludes_zero_are_counted(tmp_path):
    rows = []
    for kind, mean, myopic in (("lots", 30.0, 40.0), ("spread", 3.0, -90.0)):
        setting = f"domain=lego;regime=high_teaching;futures={kind}"
        rows.append(case("sample", "executed_cost", 1000.0, 50.0, setting))
        over = {"mean": mean, "myopic": myopic, "hindsight": -60.0}
        rows += [case(method, "executed_cost_over_sample", cost, 10.0, setting) for method, cost in over.items()]
    table(tmp_path, "tomorrow_3", rows)
    section = tomorrow(sources(tmp_path))
    assert "the mean of tomorrow costs more than planning for samples in 1 of 2 cases, " in section.parts[0]
    assert "planning for today alone in 1 of 2 cases (the other way round in 1)" in section.parts[0]
    assert "would save in 2 of 2 cases" in section.parts[0]
    [sheet] = section.sheets
    first = ["lego, high cost of teaching, lots", "1000 [950, 1050]"]
    assert sheet.rows[0] == [*first, "30.0 [20.0, 40.0]", "40.0 [30.0, 50.0]", "-60.0 [-70.0, -50.0]"]


def test_a_study_is_told_over_all_its_cases_and_a_single_case_as_it_is(tmp_path):
    rows = []
    for setting, saving in (
        ("domain=lego;predictor=walls;skills=measured;regime=high_teaching;pretrained=0", 90.0),
        ("domain=lego;predictor=walls;skills=measured;regime=all;pretrained=all", 20.0),
        ("domain=board;predictor=walls;skills=measured;regime=board;pretrained=0", 0.0),
    ):
        costs = {"once": 100.0, "outcomes": 100.0, "simulated": 100.0, "ahead": 100.0 - saving, "adl_true": 75.0}
        rows += [case(way, "executed_cost", cost, 1.0, setting) for way, cost in costs.items()]
        rows += [case(way, "executed_saving", 100.0 - costs[way], 5.0, setting) for way in ("outcomes", "ahead")]
        if saving:
            rows.append(case("ahead", "price_regained", saving / 25.0, 0.1, setting))
    table(tmp_path, "replanning_3", rows)
    section = replanning(sources(tmp_path))
    [sheet] = section.sheets
    costs = ["100", "100", "100", "80", "75"]
    assert sheet.rows[0] == ["lego, walls, measured", *costs, "20.0 [15.0, 25.0]", "80% [70%, 90%]"]
    assert sheet.rows[1][0] == "board, walls, measured"
    assert sheet.rows[1][-1] == "there is none"
    assert "saves in 0 of 2 cases. " in section.parts[0]
    assert "saves in 1 of 2 cases; " in section.parts[0]


def test_what_asking_saves_is_the_tables_difference_turned_round(tmp_path):
    columns = "domain,regime,c_ask,kind,policy,sets,questions,total,total_low,total_high,minus,minus_low,minus_high"
    rows = [
        ("lego", "low_teaching", 20, kind, policy, 40, 2.0, 500.0, 490.0, 510.0, minus, minus - 4.0, minus + 2.0)
        for kind in ("hurried", "specialist", "indifferent", "all")
        for policy, minus in (("nothing", 10.0 if kind == "hurried" else -10.0), ("everything", -1.0), ("worth", 0.0))
    ]
    rows += [(*row[:4], "uncertain", *row[5:]) for row in rows if row[4] == "everything"]
    table(tmp_path, "preferences_3", rows, columns)
    section = preferences(sources(tmp_path))
    [sheet] = section.sheets
    assert sheet.rows[0][:2] == ["everybody, lego, low cost of teaching", "2.0"]
    assert sheet.rows[0][2:] == ["500 [490, 510]", "10.0 [8.0, 14.0]", "1.0 [-1.0, 5.0]", "1.0 [-1.0, 5.0]"]
    assert "nothing in 1 of 1 cases, and against asking everything in 0 of 1 cases" in section.parts[0]
    assert "1 cases (0 with specialised people, 1 with hurried people, 0 with indifferent people)" in section.parts[0]


def test_the_committed_tables_are_on_the_page_and_saved_as_they_are(tmp_path):
    """`scripts/thesis.sh` copies the report's tables over the committed ones."""
    save_report(tmp_path, "t", [], [section(sources(COMMITTED)) for section in SECTIONS])
    for name in ("tomorrow_3", "replanning_3", "preferences_3"):
        assert (tmp_path / "tables" / f"{name}.csv").read_bytes() == (COMMITTED / f"{name}.csv").read_bytes()


def test_links_lead_to_headings_of_files():
    for section in SECTIONS:
        [link] = [part for part in section(sources(COMMITTED)).parts if isinstance(part, Link)]
        text = (ROOT / link.file).read_text()
        assert re.search(rf"^#+ {re.escape(link.heading)}$", text, flags=re.MULTILINE)
    assert Link("docs/a.md", "Does it pay?").href == "../../docs/a.md#does-it-pay"


@pytest.mark.parametrize("section", SECTIONS)
def test_without_its_table_a_section_says_how_it_is_made(section, tmp_path):
    for folder in (None, tmp_path):
        made = section(sources(folder))
        assert made.sheets == []
        assert made.parts[0].startswith("Left out: there is no ")
        assert (ROOT / made.commands[0].split()[1]).is_file()


def test_another_table_of_that_name_is_refused(tmp_path):
    (tmp_path / "tomorrow_3.csv").write_text("a,b\n1,2\n")
    with pytest.raises(ArtifactError, match=r"tomorrow_3\.csv: lacks columns method, setting"):
        tomorrow(sources(tmp_path))
    (tmp_path / "tomorrow_3.csv").write_bytes(b"")
    with pytest.raises(ArtifactError, match=r"tomorrow_3\.csv: cannot be read"):
        tomorrow(sources(tmp_path))
