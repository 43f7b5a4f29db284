"""Prose whose numbers come from tables: lookups and formats by hand, and the committed page is that of its tables."""

import re
from pathlib import Path

import pytest

from p2l.errors import ArtifactError
from p2l.evaluation.prose import Cell, interval, number, points, render_page

ROOT = Path(__file__).parents[2]
TABLES = ROOT / "results" / "thesis" / "tables"
TEMPLATE = ROOT / "docs" / "results.md.j2"
NAN = float("nan")


@pytest.fixture
def tables(tmp_path):
    (tmp_path / "long.csv").write_text(
        "method,setting,metric,mean,low,high,n,thesis\n"
        "rc,world=shelf,success,0.853,0.8212,0.8848,5,0.832\nrc,,cost,1234.5,,,3,\n"
    )
    (tmp_path / "other.csv").write_text("case,world,success_percent\nexact,door,99.7\nexact,shelf,100\n")
    return tmp_path


def test_cells_are_found_and_written_with_their_intervals(tables):
    assert render_page('{{ cell("long", "rc", "world=shelf", "success") | pct }}', tables) == "85.3 % (82.1 to 88.5)\n"
    assert render_page('{{ cell("long", "rc", "world=shelf", "success") | pct_thesis }}', tables) == "83.2 %\n"
    assert render_page('{{ cell("long", "rc", "", "cost") | ci(1) }}', tables) == "1,234.5\n"
    assert render_page('{{ cell("long", "rc", "", "cost").n }}  \nend', tables) == "3\nend\n"
    found = render_page('{{ look("other", "success_percent", case="exact", world="door") | num(1) }} %', tables)
    assert found == "99.7 %\n"


def test_formats_by_hand():
    assert interval(Cell(0.5, 0.5, 0.5, 3, NAN), 1, 100.0, " %") == "50.0 %"
    assert points(Cell(0.178, 0.139, 0.219, 5, NAN)) == "+17.8 (13.9 to 21.9)"
    assert points(Cell(-0.0001, -0.1, 0.1, 5, NAN)) == "0.0 (-10.0 to 10.0)"
    assert points(Cell(-0.02, -0.1, 0.06, 5, NAN)) == "-2.0 (-10.0 to 6.0)"
    assert number(-0.004, 2) == "0.00"
    assert number(253210.0) == "253,210"


@pytest.mark.parametrize(
    ("template", "told"),
    [
        ('{{ cell("long", "pp", "world=shelf", "success") | pct }}', r"long\.csv: 0 rows with method=pp, .*wants one"),
        ('{{ look("other", "success_percent", case="exact") }}', r"other\.csv: 2 rows with case=exact"),
        ('{{ look("other", "low", case="exact", world="door") }}', r"has no column low; it has case, world"),
        ('{{ cell("long", "rc", "", "cost") | thesis }}', "a number that its table leaves empty"),
        ('{{ cell("none", "rc", "", "cost") }}', r"none\.csv: cannot be read"),
        ("{{ typo }}", "template: 'typo' is undefined"),
        ("{% for %}", "the page's template"),
        (
            '{{ look("other", "case", success_percent=99.7) | num }}',
            "the page's template: must be real number, not str",
        ),
        (
            '{{ look("other", "case", success_percent=99.7) | ci }}',
            "the page's template: 'str' object has no attribute",
        ),
    ],
)
def test_what_no_table_holds_is_named_and_leaves_no_hole(tables, template, told):
    with pytest.raises(ArtifactError, match=told):
        render_page(template, tables)


def test_the_committed_page_is_the_one_of_the_committed_tables():
    """Run `make results` after new tables have landed."""
    page = TEMPLATE.with_suffix("").read_text(encoding="utf-8")
    assert page == render_page(TEMPLATE.read_text(encoding="utf-8"), TABLES)


def test_no_result_stands_in_the_template_itself():
    prose = re.sub(r"\{[{%].*?[%}]\}", "", TEMPLATE.read_text(encoding="utf-8"), flags=re.DOTALL)
    assert re.findall(r"\d+\.\d+|\d+ ?%", prose) == ["95 %"]
