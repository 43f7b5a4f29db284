import base64
import dataclasses
from html.parser import HTMLParser

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from p2l.errors import ArtifactError, InputError
from p2l.evaluation.team.look import amount
from p2l.evaluation.team.page import PageContent, check_page, cost_without_lessons, plan_page, write_page
from p2l.team.shop import Ruling, plan_shop
from p2l.text import drawable
from tests.evaluation.team.shop_instances import day

VOID = {"meta", "img", "br"}
TWO = ("Panda", "UR5")


class Page(HTMLParser):
    """Checks that elements are closed in turn; keeps elements, texts and the cells of tables."""

    def __init__(self, text):
        super().__init__(convert_charrefs=True)
        self.open, self.elements, self.text, self.tables, self.bold = [], [], "", [], []
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        assert len({key for key, _ in attrs}) == len(attrs)
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)
        if tag == "table":
            self.tables.append([])
        if tag == "tr":
            self.tables[-1].append([])
        if tag in ("td", "th"):
            self.tables[-1][-1].append("")

    def handle_endtag(self, tag):
        assert tag not in VOID
        assert self.open.pop() == tag

    def handle_data(self, data):
        if "style" in self.open:
            return
        self.text += data
        if "td" in self.open or "th" in self.open:
            self.tables[-1][-1][-1] += data

    @property
    def day(self):
        """Rows of the table of the day, without its head."""
        return self.tables[0][1:]


def page_of(shop, plan=None, title="Monday", **more):
    return plan_page(PageContent(shop, plan or plan_shop(shop), title, **more))


def test_the_page_has_every_task_once_in_order_with_its_numbers():
    shop = day(12, TWO, courses=2, order="any", seed=2)
    plan = plan_shop(shop)
    rows = Page(page_of(shop, plan)).day
    apart = len(rows) - shop.n
    assert apart == sum(shop.completes[lesson] < 0 for lesson, _ in plan.taught) > 0
    assert [row[1] for row in rows[apart:]] == [shop.tasks[group] for group in plan.sequence]
    assert [row[0] for row in rows] == [str(step) for step in range(1, len(rows) + 1)]
    for row, group in zip(rows[apart:], plan.sequence, strict=True):
        assert row[2] == ["attempt", "handed over", "lesson"][plan.decision[group]]
        assert row[3] == ("person" if plan.robot[group] < 0 else shop.robots[plan.robot[group]])
        assert row[6] == f"{plan.expected_cost[group]:,.1f}"
        assert float(row[5].split()[0]) == pytest.approx(100 * plan.p_success[group], abs=0.06)
    assert "by robots" in Page(page_of(shop, plan)).text


def test_the_headline_tells_cost_proof_and_cost_without_lessons():
    shop = day(8, counts=2)
    plan = plan_shop(shop)
    text = Page(page_of(shop, plan)).text
    none = plan_shop(dataclasses.replace(shop, max_lessons=0))
    assert f"{plan.objective:,.1f} expected cost, proven optimal" in text
    assert f"Without any lesson it would be {none.objective:,.1f}" in text
    assert "unit of the given costs" in text
    assert cost_without_lessons(shop, plan) == pytest.approx(none.objective)
    open_plan = dataclasses.replace(plan, status="time_limit", lower_bound=plan.objective / 1.25)
    assert "at most 25.00% above the optimum" in Page(page_of(shop, open_plan)).text


def test_a_lesson_that_is_demanded_may_cost_more_than_none():
    shop = day(2, choice=np.array([Ruling.LEARN, Ruling.FREE]), c_demo=np.full((1, 2), 500.0))
    text = Page(page_of(shop)).text
    assert "the lessons cost " in text
    alone = dataclasses.replace(shop, c_hum=np.array([np.inf, 100.0]), c_rob=np.array([[np.inf, 10.0]]))
    assert "Without any lesson the day could not be done." in Page(page_of(alone)).text


def test_reasons_break_even_remarks_limits_and_inputs_are_shown():
    shop = day(5, TWO, counts=2, max_lessons=3, max_teaching=450.0, order="partial", before=np.array([[0, 3]]))
    reasons = [{
        "lesson": "task 1", "robot": "UR5", "c_demo": 150.0, "serves": ["task 2", "task 3"], "saving_resolved": 12.5,
        "saving_others_fixed": None, "stays_up_to": float("inf"),
    }]  # fmt: skip
    other = [{"lesson": "task 4", "robot": "Panda", "c_demo": 150.0, "pays_below": 66.0}]
    page = Page(page_of(shop, reasons=reasons, remarks=["A cost was assumed."], break_even=other))
    assert ["task 1", "UR5", "150.0", "task 2, task 3", "12.5", "–", "any cost"] in page.tables[1]
    assert ["task 4", "Panda", "150.0", "66.0"] in page.tables[2]
    for text in ("A cost was assumed.", "at most 3 lessons, at most 450.0 of teaching", "task 0 before task 3"):
        assert text in page.text
    assert len(page.tables) == 5
    assert [row[0] for row in page.tables[3][1:]] == list(shop.tasks)
    assert [row[0] for row in page.tables[4][1:]] == list(shop.lessons)


def test_no_lesson_pays_and_the_nearest_would_below_its_break_even():
    shop = day(2, c_demo=np.full((1, 2), 1e4))
    other = [{"lesson": "gear", "robot": "arm", "c_demo": 1e4, "pays_below": 66.0}]
    page = Page(page_of(shop, break_even=other))
    assert "No lesson pays; gear would below 66.0." in page.text
    assert page.tables[1][0] == ["lesson", "costs", "would pay below"]  # one robot has no column


def test_names_are_escaped_and_nothing_runs_or_is_fetched(tmp_path):
    bad = '<script>alert("1")</script>'
    shop = day(3, (f"{bad}r", "'\"><img src=x onerror=y>"), courses=1, tasks=(f"{bad}a", "</table></style>", "a&amp;b"))
    shop = dataclasses.replace(shop, lessons=(f"{bad}l", "</td>", "c", "d"))
    reasons = [{"lesson": bad, "robot": bad, "serves": [bad], "c_demo": bad}]
    png = b"\x89PNG and the rest"
    plan = plan_shop(shop)
    content = PageContent(shop, plan, bad, reasons, reasons, remarks=[bad], figure_png=png)
    write_page(tmp_path / "plan.html", content)
    text = (tmp_path / "plan.html").read_text(encoding="utf-8")
    page = Page(text)
    assert {tag for tag, _ in page.elements}.isdisjoint({"script", "iframe", "object", "link", "base", "form"})
    assert not [key for _, attrs in page.elements for key in attrs if key.startswith("on")]
    sources = [attrs[key] for _, attrs in page.elements for key in ("src", "href") if key in attrs]
    assert sources == ["data:image/png;base64," + base64.b64encode(png).decode()]
    assert "url(" not in text
    assert "@import" not in text
    assert sorted(row[1] for row in page.day if row[1] != "no task of today") == sorted(shop.tasks)
    assert page.text.count(bad) >= 7
    assert text.startswith("<!DOCTYPE html>\n<html lang=")
    assert [path.name for path in tmp_path.iterdir()] == ["plan.html"]


@settings(max_examples=20)
@given(st.lists(st.text(min_size=1), min_size=2, max_size=4, unique=True))
def test_any_name_is_shown_as_it_is_and_isolated(names):
    shop = day(len(names), tasks=tuple(names), choice=np.full(len(names), Ruling.DELEGATE))
    text = page_of(shop, title=names[0])
    text.encode("utf-8")
    rows = Page(text).day
    assert [row[1] for row in rows] == [drawable(each) for each in names]
    assert text.count("<bdi>") == text.count("</bdi>") >= len(names)


def test_names_from_the_right_keep_their_joiners_and_lose_overrides():
    assert drawable("می\u200cخواهم") == "می\u200cخواهم"
    assert drawable("a\u202eb\n") == "a\\u202eb\\n"
    assert "<bdi>تركيب</bdi>" in page_of(day(1, tasks=("تركيب",)))


def test_a_page_of_a_thousand_tasks_leaves_long_inputs_out():
    shop = day(1000, TWO, choice=np.full(1000, Ruling.DELEGATE))
    page = Page(page_of(shop))
    assert len(page.day) == 1000
    assert "Tasks (1,000): too many to list here." in page.text


@pytest.mark.parametrize(("value", "text"), [
    (0.0, "0.0"), (1234.56, "1,234.6"), (0.5, "0.500"), (0.00123, "0.00123"), (1e-9, "1e-09"), (3e15, "3e+15"),
    (float("nan"), "unknown"), (float("inf"), "not possible"), (-2.0, "-2.0"),
])  # fmt: skip
def test_amounts_are_short_and_keep_three_digits(value, text):
    assert amount(value) == text


def test_a_page_of_another_cost_or_day_is_refused(tmp_path):
    shop = day(5, counts=2)
    plan, path = plan_shop(shop), tmp_path / "plan.html"
    assert not check_page(path, shop, plan)
    write_page(path, PageContent(shop, plan, "Monday", remarks=["Anything."]))
    text = path.read_text(encoding="utf-8")
    assert check_page(path, shop, plan)
    total = f"<b>{plan.objective:,.1f}</b>"
    for old, new, what in (
        (total, "<b>1.0</b>", "cost"),
        (">attempt<", ">lesson<", "day"),
        ("optimal", "fair", "cost"),
    ):
        assert old in text
        path.write_text(text.replace(old, new, 1), encoding="utf-8")
        with pytest.raises(InputError, match=f"does not show the {what} of this plan"):
            check_page(path, shop, plan)
    path.write_bytes(b"\xff\xfe")
    with pytest.raises(ArtifactError):
        check_page(path, shop, plan)


def test_a_cost_up_to_which_lessons_are_given_is_no_column_where_none_is_told():
    reasons = [{"lesson": "task 1", "robot": "arm", "c_demo": 150.0, "stays_up_to": None}]
    heads = Page(page_of(day(2), reasons=reasons)).tables[1][0]
    assert heads[-1] == "saves, with the other lessons as they are"
