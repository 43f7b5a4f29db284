import dataclasses
import warnings

import numpy as np
import pytest
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from matplotlib import font_manager
from matplotlib.collections import LineCollection, PolyCollection

from p2l.evaluation.fonts import fonts_for
from p2l.evaluation.team.shop_figure import save_shop_figure, shop_figure
from p2l.team.problem import Decision
from p2l.team.shop import Ruling, plan_shop
from p2l.team.shop.rows import plan_rows
from tests.evaluation.team.shop_instances import day

TWO = ("Panda", "UR5")


@pytest.fixture(scope="module")
def rare():
    """A letter that no installed font has."""
    letters = [chr(code) for code in range(0x10000, 0x20000) if chr(code).isprintable()]
    return min(fonts_for(letters).missing)


def drawn(shop):
    made = plan_shop(shop)
    return made, shop_figure(shop, made)


def arcs(figure):
    (found,) = [each for each in figure.axes[0].collections if isinstance(each, LineCollection)]
    return {(round(each[0, 0]), round(each[-1, 0])) for each in found.get_segments()}


def labels(axes):
    return [each.get_text() for each in axes.get_xticklabels()]


@pytest.mark.parametrize("shop", [
    day(8), day(8, TWO, courses=2), day(30, TWO, courses=3, counts=3, order="any"), day(70, TWO, courses=2, counts=2),
])  # fmt: skip
def test_one_arc_runs_from_each_lesson_to_each_row_that_it_serves(shop):
    made, figure = drawn(shop)
    rows = plan_rows(shop, made)
    expected = set()
    for place, row in enumerate(rows, start=1):
        if row.decision == Decision.ACT and row.lesson >= 0:
            (source,) = [k for k, one in enumerate(rows, start=1) if one.decision == 2 and one.lesson == row.lesson]
            assert row.robots[0] in rows[source - 1].robots
            expected.add((source, place))
    assert arcs(figure) == expected
    lessons = {lesson for row in rows if row.source >= 0 for lesson in [row.lesson]}
    assert len({start for start, _ in arcs(figure)}) == len(lessons) > 0


@pytest.mark.parametrize("shop", [day(6, TWO, courses=2, counts=4), day(65, counts=2)])
def test_bars_are_the_costs_of_the_rows_and_add_up_to_the_plan(shop):
    made, figure = drawn(shop)
    rows = plan_rows(shop, made)
    assert sum(row.expected_cost for row in rows) == pytest.approx(made.objective)
    assert sum(row.copies for row in rows) == shop.count.sum()
    certain, risk = [each for each in figure.axes[-1].collections if isinstance(each, PolyCollection)]
    tops = dict.fromkeys(range(1, len(rows) + 1), 0.0)
    for box in [*certain.get_paths(), *risk.get_paths()]:
        x, y = box.vertices.max(axis=0)
        tops[round(x - 0.4)] = max(tops[round(x - 0.4)], y)
    assert list(tops.values()) == pytest.approx([row.expected_cost for row in rows])
    assert "unit" in figure.axes[-1].get_ylabel()
    for row in rows:
        if row.decision == Decision.ACT:
            risk = row.copies * (1.0 - row.p_success) * shop.c_fail[row.robots[0], row.task]
            assert row.expected_cost - row.certain_cost == pytest.approx(risk)


def test_copies_that_are_treated_alike_are_one_row():
    person = day(2, counts=4, tasks=("gear", "peg"), choice=np.array([Ruling.DELEGATE, Ruling.LEARN]))
    made, figure = drawn(person)
    assert labels(figure.axes[-1]) == ["gear ×4", "peg", "peg ×3"]
    assert [row.copies for row in plan_rows(person, made)] == [4, 1, 3]


def test_lessons_on_no_task_of_today_stand_at_the_left_and_limits_in_the_title():
    shop = day(4, courses=2, order="any", counts=2, max_lessons=3, max_teaching=270.0)
    made, figure = drawn(shop)
    given = [shop.lessons[lesson] for lesson, _ in made.taught if shop.completes[lesson] < 0]
    assert given
    assert labels(figure.axes[-1])[: len(given)] == given
    (title,) = figure.texts
    assert f"{made.objective:,.1f}" in title.get_text()
    assert "at most 3 lessons, at most 270.0 of teaching" in title.get_text()


def test_each_robot_has_a_line_on_which_its_work_is_marked():
    shop = day(8, TWO, counts=2, seed=1)
    made, figure = drawn(shop)
    _, who, _ = figure.axes
    assert [each.get_text() for each in who.get_yticklabels()] == ["person", *TWO]
    (marks,) = [each for each in who.collections if isinstance(each, PolyCollection)]
    middles = {tuple(np.round(each.vertices[:4].mean(axis=0)).astype(int).tolist()) for each in marks.get_paths()}
    rows = plan_rows(shop, made)
    assert middles == {(place, robot + 1) for place, row in enumerate(rows, 1) for robot in row.robots or (-1,)}
    assert len(shop_figure(day(8), plan_shop(day(8))).axes) == 2


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_a_figure_is_written_whole_with_the_same_bytes_and_without_a_warning(tmp_path, suffix):
    shop = day(5, TWO, tasks=("шестерня", "γρανάζι", "تركيب الترس", "$5_{$ <b>", "a\nb"), counts=2)
    made = plan_shop(shop)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        save_shop_figure(tmp_path / f"plan.{suffix}", shop, made)
    start = {"png": b"\x89PNG", "svg": b"<?xml", "pdf": b"%PDF"}[suffix]
    assert (tmp_path / f"plan.{suffix}").read_bytes().startswith(start)
    assert [path.name for path in tmp_path.iterdir()] == [f"plan.{suffix}"]
    if suffix == "png":
        save_shop_figure(tmp_path / "again.png", shop, made)
        assert (tmp_path / "again.png").read_bytes() == (tmp_path / "plan.png").read_bytes()


def test_no_name_leaves_the_picture_and_no_label_lies_over_another_panel():
    shop = day(20, ("an arm with a long name", "UR5"), tasks=tuple(f"a task with a name, {i}" for i in range(20)))
    _, figure = drawn(shop)
    renderer = figure.canvas.get_renderer()
    width, height = figure.bbox.size
    for axes in figure.axes:
        box = axes.get_tightbbox(renderer)
        assert min(box.x0, box.y0) >= 0.0
        assert box.x1 <= width
        assert box.y1 <= height
    boxes = [axes.get_window_extent(renderer) for axes in figure.axes]
    assert boxes[0].y0 >= boxes[1].y1 > boxes[1].y0 >= boxes[2].y1


def test_a_name_without_glyphs_is_numbered_with_one_warning(tmp_path, rare):
    shop = day(3, (f"{rare}1", "UR5"), tasks=("gear", f"{rare} peg", f"{rare} bolt"), counts=2)
    made = plan_shop(shop)
    with pytest.warns(UserWarning, match="3 names have letters that no installed font") as caught:
        save_shop_figure(tmp_path / "plan.png", shop, made)
    assert len(caught) == 1
    with pytest.warns(UserWarning, match="numbers of rows"):
        figure = shop_figure(shop, made)
    texts = labels(figure.axes[-1])
    rows = plan_rows(shop, made)
    for place, (text, row) in enumerate(zip(texts, rows, strict=True), start=1):
        assert text.startswith("gear" if row.task == 0 else f"#{place}")
    assert [each.get_text() for each in figure.axes[1].get_yticklabels()] == ["person", "robot 1", "UR5"]


def test_the_character_map_of_an_installed_font_decides(tmp_path, monkeypatch, rare):
    assert not fonts_for([rare]).can_draw(rare)
    path = tmp_path / "rare.ttf"
    write_font(path, "Rare Test", {ord(rare): "letter"})
    monkeypatch.setattr(font_manager.fontManager, "ttflist", list(font_manager.fontManager.ttflist))
    font_manager.fontManager.addfont(path)
    fonts = fonts_for([f"{rare} peg"])
    assert fonts.families == ("DejaVu Sans", "Rare Test")
    assert fonts.can_draw(rare)
    assert fonts_for([rare, "\U0010fffd"]).missing == {"\U0010fffd"}
    shop = dataclasses.replace(day(2), tasks=("gear", f"{rare} peg"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        figure = shop_figure(shop, plan_shop(shop))
        save_shop_figure(tmp_path / "plan.png", shop, plan_shop(shop))
    assert labels(figure.axes[-1]) == ["gear", f"{rare} peg"]
    font_manager.fontManager._findfont_cached.cache_clear()


def test_plain_names_need_one_font_and_joiners_no_glyph():
    assert fonts_for(["gear", "peg"]).families == ("DejaVu Sans",)
    assert fonts_for(["g\u200der"]).missing == frozenset()


def write_font(path, family, letters):
    """A font in which every letter is a square."""
    pen = TTGlyphPen(None)
    pen.moveTo((0, 0))
    for point in ((0, 500), (500, 500), (500, 0)):
        pen.lineTo(point)
    pen.closePath()
    glyphs = [".notdef", *letters.values()]
    builder = FontBuilder(1000, isTTF=True)
    builder.setupGlyphOrder(glyphs)
    builder.setupCharacterMap(letters)
    builder.setupGlyf({name: pen.glyph() for name in glyphs})
    builder.setupHorizontalMetrics(dict.fromkeys(glyphs, (600, 0)))
    builder.setupHorizontalHeader(ascent=800, descent=-200)
    builder.setupNameTable({"familyName": family, "styleName": "Regular"})
    builder.setupOS2(usWeightClass=400)
    builder.setupPost()
    builder.save(path)
