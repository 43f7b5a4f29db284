"""The day as it happens: every rest of a small day against every plan there is, and laws of what is learnt."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from shop_instances import small_shop

from p2l.errors import ConfigError
from p2l.team import Problem
from p2l.team.day import (
    Event,
    EventError,
    EventOutcome,
    SkillPrior,
    advance,
    begin,
    change_of,
    explain_change,
    next_step,
    remaining_shop,
    replan,
)
from p2l.team.day.record import ALLOWED
from p2l.team.day.skills import expected_skill
from p2l.team.problem import Decision
from p2l.team.shop import Ruling, Shop, plan_shop, shop_outcome
from p2l.team.shop.oracle import every_plan

ORDERS = ("fixed", "any", "partial")


def event_of(step, outcome):
    return Event(step.task, step.copy, step.decision, step.robot, step.lesson, outcome)


def morning(shop, **options):
    try:
        return begin(shop, plan_shop(shop), **options)
    except ConfigError:
        assume(False)


def walk(day, outcome):
    """Days from the first event to the last, each step as planned and ended as `outcome(step)` says."""
    while (step := next_step(day)) is not None:
        day = advance(day, event_of(step, outcome(step)))
        yield day


def certain(shop):
    """The same day with probabilities of 0 and 1."""
    return replace(shop, transfer=np.round(shop.transfer), pretrained=np.round(shop.pretrained))


def as_predicted(step):
    return (
        EventOutcome.DONE
        if step.decision != Decision.ACT
        else EventOutcome.SUCCESS
        if step.p_success
        else EventOutcome.FAILURE
    )


def by_chance(rng):
    """Each step ends badly two times in five, where it can."""
    return lambda step: ALLOWED[step.decision][int(rng.random() < 0.4) % len(ALLOWED[step.decision])]


@pytest.mark.parametrize("order", ORDERS)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_every_plan_anew_is_the_best_of_what_is_left(order, seed):
    rng = np.random.default_rng(seed)
    shop = small_shop(rng, order)
    begun = morning(shop, setting=SkillPrior(prior_n=1.0, spread=2.0))
    day = begun
    for day in walk(begun, by_chance(rng)):
        if day.rest is None:
            break
        assert_allclose(day.plan.objective, every_plan(day.rest.shop)[0], rtol=2e-9)
        assert_allclose(day.plan.objective, replan(day).plan.objective, rtol=2e-9)
        assert day.plan.lower_bound >= day.plan.objective * (1 - 2e-9)
    assert (day.standing.done == shop.count).all()


@pytest.mark.parametrize("order", ORDERS)
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=15, deadline=None)
def test_a_day_that_goes_as_predicted_with_certainty_costs_what_was_planned(order, seed):
    shop = certain(small_shop(np.random.default_rng(seed), order))
    day = morning(shop)
    total = day.expected_total
    for after in walk(day, as_predicted):
        assert_allclose(after.expected_total, total, rtol=1e-9)
        if after.rest is not None:
            assert_allclose(every_plan(after.rest.shop)[0], after.left, rtol=2e-9, atol=1e-9)
            assert change_of(day, after).is_none
        day = after
    assert_allclose(day.spent, total, rtol=1e-9)


@given(seed=st.integers(0, 2**32 - 1), cut=st.integers(0, 10))
@settings(max_examples=20, deadline=None)
def test_a_day_is_a_function_of_its_events(seed, cut):
    rng = np.random.default_rng(seed)
    shop = small_shop(rng, "fixed")
    begun = morning(shop)
    days = list(walk(begun, by_chance(rng)))
    again = begun
    for event in days[-1].events[: min(cut, len(days))]:
        again = advance(again, event)
    reached = ([begun, *days])[min(cut, len(days))]
    assert again.events == reached.events
    assert again.expected_total == reached.expected_total
    if again.plan is not None:
        for name in ("taught", "sequence", "decision", "robot", "lesson", "p_success", "expected_cost"):
            assert np.array_equal(getattr(again.plan, name), getattr(reached.plan, name))


PROBABILITIES = st.lists(st.floats(0, 1), min_size=1, max_size=5).map(np.array)


@given(rho=PROBABILITIES, prior_n=st.floats(0.1, 100), spread=st.floats(0, 5))
def test_without_outcomes_nothing_is_believed_anew(rho, prior_n, spread):
    none = np.zeros(len(rho))
    assert np.array_equal(expected_skill(rho, none, none, none, SkillPrior(prior_n, spread)), rho)


@given(rho=PROBABILITIES, prior_n=st.floats(0.2, 50), spread=st.floats(0.1, 10), data=st.data())
@settings(deadline=None)
def test_what_is_expected_of_the_next_outcome_is_what_is_expected_now(rho, prior_n, spread, data):
    """Beliefs are a martingale, in whatever order outcomes come: a success raises all tasks, a failure lowers them."""
    rho = np.clip(rho, 0.01, 0.99)
    count = st.lists(st.integers(0, 3), min_size=len(rho), max_size=len(rho)).map(lambda each: np.array(each, float))
    won, lost, trials = data.draw(count), data.draw(count), data.draw(count)
    tried = data.draw(st.integers(0, len(rho) - 1))
    one, setting = np.eye(len(rho))[tried], SkillPrior(prior_n, spread)
    now = expected_skill(rho, trials, won, lost, setting)
    better, worse = (
        expected_skill(rho, trials, won + s, lost + f, setting) for s, f in ((one, 0 * one), (0 * one, one))
    )
    assert (better >= now - 1e-9).all()
    assert (worse <= now + 1e-9).all()
    assert_allclose(now[tried] * better + (1 - now[tried]) * worse, now, atol=2e-8)


def test_posteriors_by_hand():
    """No shift: the beta distribution. Many outcomes: their rate. Certain predictions: only what was tried moves."""
    rho, none = np.array([0.5, 0.8]), np.zeros(2)
    alone = expected_skill(rho, none, none, np.array([2.0, 0.0]), SkillPrior(2.0, 0.0))
    assert alone.tolist() == [0.25, 0.8]
    many = expected_skill(rho, none, np.array([9000.0, 0.0]), np.array([1000.0, 0.0]), SkillPrior(2.0, 1.0))
    assert many[0] == pytest.approx(0.9, abs=1e-3)
    sure = expected_skill(
        np.array([1.0, 1.0, 0.0]), np.zeros(3), np.zeros(3), np.array([1.0, 0, 0]), SkillPrior(4.0, 1.0)
    )
    assert sure.tolist() == [0.8, 1.0, 0.0]
    shared = expected_skill(rho, none, none, np.array([1.0, 0.0]), SkillPrior(2.0, 1.0))
    measured = expected_skill(rho, np.array([0.0, 100.0]), none, np.array([1.0, 0.0]), SkillPrior(2.0, 1.0))
    assert 0.5 < shared[1] < measured[1] < 0.8
    assert expected_skill(rho, none, none, np.array([1.0, 0.0]), SkillPrior(2.0, 1.0), shared=False).tolist() == [
        1 / 3,
        0.8,
    ]


def three_alike(**changes):
    """A lesson on the first serves the two after it."""
    cost = {"c_rob": 10.0, "c_hum": 100.0, "c_fail": 100.0, "c_demo": 120.0}
    problem = Problem(
        tuple("abc"), **{name: np.full(3, value) for name, value in cost.items()}, pretrained=np.zeros(3),
        transfer=np.full((3, 3), 0.9),
    )  # fmt: skip
    return replace(Shop.of_problem(problem), **changes)


def enter(day, *events):
    for event in events:
        day = advance(day, event)
    return day


def test_a_lesson_that_fails_is_left():
    """Planned 120 + 20 + 20. The lesson fails on b: 110 for it, and c is expected to cost more than the person does."""
    shop = three_alike()
    day = begin(shop, plan_shop(shop), setting=SkillPrior(prior_n=1.0, spread=3.0))
    taught = enter(day, Event(0, 1, Decision.LEARN, 0, 0, EventOutcome.DONE))
    assert change_of(day, taught).is_none
    assert (taught.spent, taught.expected_total) == (120.0, pytest.approx(160.0))
    failed = enter(taught, Event(1, 1, Decision.ACT, 0, 0, EventOutcome.FAILURE))
    change = change_of(taught, failed)
    skill = failed.standing.learnt[0].expected
    assert skill[2] < 0.9
    assert 10.0 + (1 - skill[2]) * 100.0 == pytest.approx(failed.left)
    assert failed.spent == 230.0
    assert explain_change(shop, change) == f"no change; expected cost of the day 160.0 -> {failed.expected_total:,.1f}"


def test_a_change_is_told():
    """As above, with a person who does c for 25: kept at 20 expected until the lesson fails on b."""
    shop = three_alike(c_hum=np.array([100.0, 100.0, 25.0]))
    begun = begin(shop, plan_shop(shop), setting=SkillPrior(2.0, 1.0))
    day = enter(begun, Event(0, 1, Decision.LEARN, 0, 0, EventOutcome.DONE))
    failed = enter(day, Event(1, 1, Decision.ACT, 0, 0, EventOutcome.FAILURE))
    text = explain_change(shop, change_of(day, failed))
    kept = 230.0 + 10.0 + 100.0 * (1 - failed.standing.learnt[0].expected[2])
    assert text.splitlines() == [
        f"expected cost of the day 160.0 -> 255.0 ({kept:,.1f} if the plan were kept)",
        "  c: robot by the lesson on a -> the person",
    ]


def test_a_demonstration_that_does_not_teach_may_be_repeated_on_the_next_copy():
    shop = three_alike(count=np.array([3, 1, 1]), choice=np.array([Ruling.LEARN, -1, -1]), max_lessons=2.0)
    day = begin(shop, plan_shop(shop))
    once = enter(day, Event(0, 1, Decision.LEARN, 0, 0, EventOutcome.NOT_TAUGHT))
    assert (once.spent, once.standing.learnt, once.rest.shop.max_lessons) == (120.0, (), 1.0)
    assert (next_step(once).copy, next_step(once).decision) == (2, Decision.LEARN)
    twice = enter(once, Event(0, 2, Decision.LEARN, 0, 0, EventOutcome.DONE))
    assert twice.rest.lesson.tolist() == [1, 2]
    assert twice.rest.shop.pretrained[0].tolist() == [0.9, 0.9, 0.9]
    never = enter(once, Event(0, 2, Decision.LEARN, 0, 0, EventOutcome.NOT_TAUGHT))
    assert never.plan.decision.tolist() == [Decision.DELEGATE] * 3  # no lesson is left, though a is to be taught


def test_a_second_robot_learns_from_the_same_demonstration():
    two = three_alike()
    both = replace(
        two, robots=("arm", "gantry"), c_rob=np.array([[10.0, 10, 1e4], [10, 1e4, 10]]), c_fail=np.full((2, 3), 100.0),
        pretrained=np.zeros((2, 3)), c_demo=np.array([[40.0, 500, 500], [20.0, 500, 500]]),
        transfer=np.ones((2, 3, 3)),
    )  # fmt: skip
    day = begin(both, plan_shop(both))
    assert day.left == 40 + 20 + 10 + 10
    first = enter(day, event_of(next_step(day), EventOutcome.DONE))
    step = next_step(first)
    assert (step.task, step.copy, step.decision, step.lesson) == (0, 0, Decision.LEARN, 0)
    second = enter(first, event_of(step, EventOutcome.DONE))
    assert {each.robot for each in second.standing.learnt} == {0, 1}
    assert [second.spent, second.left] == [60.0, 20.0]
    late = enter(first, Event(1, 1, Decision.DELEGATE, -1, -1, EventOutcome.DONE))
    with pytest.raises(EventError, match="copy: 0 given; a demonstration of 'a'"):
        enter(late, Event(0, 0, Decision.LEARN, step.robot, 0, EventOutcome.DONE))


@pytest.mark.parametrize(
    ("event", "field"),
    [
        (Event(0, 2, Decision.DELEGATE, -1, -1, EventOutcome.DONE), "copy"),
        (Event(1, 1, Decision.DELEGATE, -1, -1, EventOutcome.DONE), "task"),
        (Event(0, 1, Decision.DELEGATE, -1, -1, EventOutcome.SUCCESS), "outcome"),
        (Event(0, 1, Decision.ACT, 0, 0, EventOutcome.SUCCESS), "lesson"),
        (Event(0, 1, Decision.ACT, -1, -1, EventOutcome.SUCCESS), "robot"),
        (Event(0, 1, Decision.LEARN, 0, 1, EventOutcome.DONE), "lesson"),
        (Event(0, 0, Decision.LEARN, 0, 0, EventOutcome.DONE), "copy"),
        (Event(0, 0, Decision.ACT, 0, -1, EventOutcome.SUCCESS), "copy"),
    ],
)
def test_what_cannot_have_happened_is_refused(event, field):
    shop = three_alike()
    with pytest.raises(EventError) as refused:
        advance(begin(shop, plan_shop(shop)), event)
    assert refused.value.field == field


def test_a_task_that_is_done_stays_done():
    shop = three_alike()
    day = enter(begin(shop, plan_shop(shop)), Event(0, 1, Decision.DELEGATE, -1, -1, EventOutcome.DONE))
    assert "a" not in day.rest.shop.tasks
    assert remaining_shop(shop, day.standing).shop.tasks == ("b", "c")
    with pytest.raises(EventError, match="'a' is done"):
        advance(day, Event(0, 1, Decision.DELEGATE, -1, -1, EventOutcome.DONE))
    assert_allclose(shop_outcome(day.rest.shop, day.plan.taught, day.plan.sequence).total, day.plan.objective)
