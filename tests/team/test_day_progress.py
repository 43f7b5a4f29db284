"""What is remembered of a day: it goes on to the same plan as by planning its past again, or it is not used."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from shop_instances import small_shop

from p2l.errors import ConfigError
from p2l.team.day import Event, SkillPrior, advance, begin, next_step
from p2l.team.day.entries import DayEntry, cells_of, replay
from p2l.team.day.files import key_of
from p2l.team.day.progress import PROGRESS, append_progress, day_after, first_digest, read_progress
from p2l.team.day.record import ALLOWED
from p2l.team.shop import plan_shop

ORDERS = ("fixed", "any", "partial")


def begun(rng, order, **limits):
    shop = replace(small_shop(rng, order), **limits)
    try:
        return begin(shop, plan_shop(shop), setting=SkillPrior(spread=2.0))
    except ConfigError:
        assume(False)


def walked(path, morning, rng):
    """Days after each event of a day that is remembered in a file."""
    digest, size, days = first_digest(morning, key_of(morning)), 0, [morning]
    while (step := next_step(days[-1])) is not None:
        outcome = ALLOWED[step.decision][int(rng.random() < 0.4) % len(ALLOWED[step.decision])]
        event = Event(step.task, step.copy, step.decision, step.robot, step.lesson, outcome, "=a note")
        days.append(advance(days[-1], event))
        digest, size = append_progress(path, digest, size, days[-1], f"change {len(days)}")
    return days


def entries_of(morning, day):
    key = key_of(morning)
    return [DayEntry(0, cells_of(day.shop, event, step, key)) for step, event in enumerate(day.events, start=1)]


def same(one, other, but=()):
    """Whether two records have the same fields, arrays included."""
    for name in (field.name for field in fields(one) if field.name not in but):
        mine, theirs = getattr(one, name), getattr(other, name)
        if hasattr(mine, "__dataclass_fields__"):
            same(mine, theirs)
        elif name == "learnt":
            assert len(mine) == len(theirs)
            for each, twin in zip(mine, theirs, strict=True):
                same(each, twin)
        else:
            np.testing.assert_array_equal(mine, theirs, err_msg=name)


def same_day(one, other):
    """Two days alike; the proof and the seconds of a plan are not remembered."""
    same(one, other, but=("plan", "trials"))
    assert (one.plan is None) == (other.plan is None)
    if one.plan is not None:
        same(one.plan, other.plan, but=("seconds", "certificate"))


@pytest.mark.parametrize("order", ORDERS)
@given(seed=st.integers(0, 2**32 - 1), cut=st.floats(0.0, 1.0))
@settings(max_examples=12, deadline=None)
def test_a_day_that_is_cut_anywhere_is_remembered_as_far_as_its_lines_are_whole(tmp_path_factory, order, seed, cut):
    rng = np.random.default_rng(seed)
    path = tmp_path_factory.mktemp("day") / PROGRESS
    limits = {"max_lessons": float(rng.integers(1, 4))} if rng.random() < 0.5 else {}
    morning = begun(rng, order, **limits)
    days = walked(path, morning, rng)
    entries, key = entries_of(morning, days[-1]), key_of(morning)
    data = path.read_bytes()
    path.write_bytes(data[: round(cut * len(data))])
    known = read_progress(path, morning, key, entries)
    assert len(known) == path.read_bytes().count(b"\n")
    assert [one.change for one in known] == [f"change {step}" for step in range(2, len(known) + 2)]
    if known:
        again = day_after(morning, known)
        same_day(again, days[len(known)])
        assert (known[-1].spent, known[-1].left) == (again.spent, again.left)
        rest = replay(again, entries[len(known) :], "day").day
        assert rest.expected_total == days[-1].expected_total
        np.testing.assert_array_equal(rest.standing.done, days[-1].standing.done)


@pytest.mark.parametrize("order", ORDERS)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=8, deadline=None)
def test_a_corrected_day_is_remembered_up_to_the_row_that_was_corrected(tmp_path_factory, order, seed):
    rng = np.random.default_rng(seed)
    path = tmp_path_factory.mktemp("day") / PROGRESS
    morning = begun(rng, order)
    days = walked(path, morning, rng)
    entries, key = entries_of(morning, days[-1]), key_of(morning)
    turned = {"success": "failure", "failure": "success", "done": "not taught", "not taught": "done"}
    at = int(rng.integers(len(entries)))
    cells = dict(entries[at].cells)
    entries[at] = DayEntry(0, cells | {"outcome": turned[cells["outcome"]]})
    known = read_progress(path, morning, key, entries)
    assert len(known) == at
    after = day_after(morning, known) if known else morning
    same_day(replay(after, entries[at:], "day").day, replay(morning, entries, "day").day)


def test_what_is_remembered_of_another_day_or_was_changed_is_not_used(tmp_path):
    rng = np.random.default_rng(4)
    path, morning = tmp_path / PROGRESS, begun(rng, "fixed")
    days = walked(path, morning, rng)
    entries, key, whole = entries_of(morning, days[-1]), key_of(morning), path.read_bytes()
    assert len(read_progress(path, morning, key, entries)) == len(entries) > 3
    assert read_progress(path, replace(morning, time_limit_s=1.0), key, entries) == ()
    assert read_progress(path, morning, "another", entries) == ()
    lines = whole.splitlines(keepends=True)
    for changed in (
        b"".join(lines[1:]),
        whole.replace(b'"spent": ', b'"spent": 1'),
        b"\xff" + whole,
        b"{}\n" * 3,
    ):
        path.write_bytes(changed)
        assert read_progress(path, morning, key, entries) == ()
    path.write_bytes(b"".join([*lines[:2], *lines[3:]]))
    assert len(read_progress(path, morning, key, entries)) == 2
    path.unlink()
    path.mkdir()  # nothing is remembered then, and nothing fails
    assert read_progress(path, morning, key, entries) == ()


def test_a_plan_that_costs_something_else_or_is_none_is_planned_again(tmp_path):
    rng = np.random.default_rng(4)
    path, morning = tmp_path / PROGRESS, begun(rng, "fixed")
    days = walked(path, morning, rng)
    known = list(read_progress(path, morning, key_of(morning), entries_of(morning, days[2])))
    assert day_after(morning, known) is not None
    plan = known[-1].plan
    others = [None, {}, plan | {"objective": plan["objective"] * 1.01}, plan | {"sequence": plan["sequence"][:-1]}]
    for other in [*others, plan | {"taught": [0, 99]}, plan | {"limits": ["much"]}]:
        assert day_after(morning, [*known[:-1], replace(known[-1], plan=other)]) is None
    assert day_after(morning, []) is None


def test_a_line_is_written_over_what_does_not_hold_and_a_note_may_change(tmp_path):
    rng = np.random.default_rng(4)
    path, morning = tmp_path / PROGRESS, begun(rng, "fixed")
    days = walked(path, morning, rng)
    whole, entries = path.read_bytes(), entries_of(morning, days[-1])
    entries[0] = DayEntry(0, dict(entries[0].cells) | {"note": "mine"})
    known = read_progress(path, morning, key_of(morning), entries)
    assert len(known) == len(entries)
    assert known[0].event.note == "mine"
    append_progress(path, known[1].digest, known[1].end, days[3], "change 4")
    assert path.read_bytes() == b"".join(whole.splitlines(keepends=True)[:3])
