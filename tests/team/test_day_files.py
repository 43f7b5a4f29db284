"""day.csv: rows that cannot be, files that are cut at any byte, and what a saved shop holds."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shop_instances import small_shop

from p2l.errors import ArtifactError, InputError
from p2l.team import Problem
from p2l.team.day import begin
from p2l.team.day.entries import DayEntry, replay
from p2l.team.day.files import DAY, REFUSED, append_event, key_of, read_day, read_outcomes, restore
from p2l.team.shop import Shop, plan_shop
from p2l.team.shop.saved import SHOP, SavedShop, load_shop, save_shop

HEADER = "step,task,copy,decision,robot,lesson,outcome,note,plan\n"


def morning():
    """A lesson on the peg serves the lid and the nut."""
    cost = {"c_rob": 1.0, "c_hum": 9.0, "c_fail": 9.0, "c_demo": 8.0}
    problem = Problem(
        ("peg", "lid", "nut"), **{name: np.full(3, value) for name, value in cost.items()}, pretrained=np.zeros(3),
        transfer=np.full((3, 3), 0.8),
    )  # fmt: skip
    shop = replace(Shop.of_problem(problem), count=np.array([3, 1, 1]))
    return begin(shop, plan_shop(shop))


def entered(path, day, rows):
    """A day after some rows, each appended to a file."""
    key, file = key_of(day), read_day(path, key_of(day))
    now, wrong, _ = replay(day, file.entries, str(path))
    size = restore(path, now, key, file, wrong)
    for cells in rows[len(now.events) :]:
        now, _, problem = replay(now, [DayEntry(0, cells)], "typed")
        assert problem is None
        size = append_event(path, now, key, size)
    return now


ROWS = [{"outcome": "done"}, {"outcome": "failure", "note": "=it, slipped\nfar"}, {"outcome": "failure"}] + [
    {"task": "lid", "decision": "delegate", "outcome": "done"},
    {"outcome": "success"},
]


def test_a_file_that_is_cut_anywhere_goes_on_to_itself(tmp_path):
    path, day = tmp_path / DAY, morning()
    last = entered(path, day, ROWS)
    whole = path.read_bytes()
    assert whole.decode().startswith(HEADER)
    assert "'=it, slipped far" in whole.decode()
    for cut in range(0, len(whole), 11):
        path.write_bytes(whole[:cut])
        again = entered(path, day, ROWS)
        assert path.read_bytes() == whole
        assert again.events == replay(day, read_day(path, key_of(day)).entries, "").day.events
        assert again.expected_total == last.expected_total
    assert (tmp_path / REFUSED).exists()


def test_two_who_write_at_once(tmp_path):
    path, day = tmp_path / DAY, morning()
    entered(path, day, ROWS[:1])
    now = replay(day, read_day(path, key_of(day)).entries, "").day
    with pytest.raises(InputError, match="somebody else enters outcomes"):
        append_event(path, now, key_of(day), 3)


@pytest.mark.parametrize(
    ("row", "problem"),
    [
        ("2,peg,2,act,robot,peg,broke,", "row 3, column 'outcome': 'broke' is no outcome; give success, failure"),
        ("2,pegs,1,act,robot,peg,success,", "row 3, column 'task': 'pegs' is no task of this plan; is it 'peg'?"),
        ("2,peg,7,act,robot,peg,success,", "row 3, column 'copy': 7 given; copy 2 of 'peg' is next"),
        ("2,peg,x,act,robot,peg,success,", "row 3, column 'copy': 'x' is no number of a copy"),
        ("7,peg,2,act,robot,peg,success,", "row 3, column 'step': '7' given; 2 comes next"),
        ("2,nut,1,delegate,,,done,", "row 3, column 'task': 'peg' comes before 'nut'"),
        ("2,peg,2,act,Ada,peg,success,", "row 3, column 'robot': 'Ada' is no robot; give robot"),
        ("2,peg,2,act,robot,lid,success,", "row 3, column 'lesson': 'lid' has not been taught to 'robot'"),
        ("2,peg,2,act,robot,pegs,success,", "row 3, column 'lesson': 'pegs' is no lesson of this plan; is it 'peg'"),
        ("2,peg,2,teach,robot,lid,success,", "row 3, column 'decision': 'teach' is no decision; give act"),
        ("2,peg,2,act,robot,peg,done,", "row 3, column 'outcome': 'done' is no outcome of act; give 'success' or"),
    ],
)
def test_rows_that_cannot_be(tmp_path, row, problem):
    day = morning()
    key, name = key_of(day), "outcomes.csv"
    (tmp_path / name).write_text(f"{HEADER}1,peg,1,learn,robot,peg,done,,{key}\n{row},{key}\n")
    for entries in (read_outcomes(tmp_path / name, key), read_day(tmp_path / name, key).entries):
        after, wrong, told = replay(day, entries, name)
        assert len(after.events) == 1
        assert wrong.line == 3
        assert str(told).startswith(f"outcomes.csv, {problem}")


def test_a_shop_that_is_saved_is_the_same(tmp_path):
    """With infinite costs, limits, names of any kind; a damaged one is told."""

    @given(seed=st.integers(0, 2**32 - 1), order=st.sampled_from(("fixed", "any", "partial")))
    @settings(max_examples=20, deadline=None)
    def check(seed, order):
        shop = small_shop(np.random.default_rng(seed), order)
        shop = replace(shop, tasks=(*shop.tasks[:-1], "=a,\u0308 "))
        save_shop(tmp_path, SavedShop(shop, np.ones(shop.transfer.shape), {"bay": ("A",) * shop.n}))
        again = load_shop(tmp_path)
        assert again.extra == {"bay": ("A",) * shop.n}
        assert again.shop.tasks == shop.tasks
        for name in ("completes", "count", "c_hum", "c_rob", "c_fail", "pretrained", "c_demo", "transfer", "arcs"):
            assert np.array_equal(getattr(again.shop, name), getattr(shop, name))
        limits = ("order", "max_lessons", "max_teaching")
        assert [getattr(again.shop, name) for name in limits] == [getattr(shop, name) for name in limits]

    check()
    data = bytearray((tmp_path / SHOP).read_bytes())
    data[len(data) // 2] ^= 1
    (tmp_path / SHOP).write_bytes(data)
    with pytest.raises(ArtifactError):
        load_shop(tmp_path)
