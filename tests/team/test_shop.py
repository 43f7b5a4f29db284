"""Plans of shops against every plan there is, and laws that tie them to the thesis's problem."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from shop_instances import small_shop

from benchmarks.instances import large_shop
from p2l.errors import ConfigError, ShapeError, SolverError
from p2l.team import Problem, plan
from p2l.team.problem import Decision
from p2l.team.shop import Ruling, Shop, ShopCertificate, check_shop_plan, plan_shop, shop_outcome
from p2l.team.shop.oracle import every_plan
from p2l.team.shop.reasons import reasons_of
from p2l.team.shop.reduction import reduce_shop


def same_as_every_plan(shop):
    try:
        best = every_plan(shop)[0]
    except SolverError:
        with pytest.raises(ConfigError, match="no plan keeps the limits and the decisions"):
            plan_shop(shop)
        return
    day = plan_shop(shop)
    verdict = check_shop_plan(shop, day)
    assert day.status == "optimal"
    assert_allclose([day.objective, verdict.bound], best, rtol=2e-9)


@pytest.mark.parametrize("order", ["fixed", "any", "partial"])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=70, deadline=None)
def test_no_plan_of_a_small_shop_is_better(order, seed):
    same_as_every_plan(small_shop(np.random.default_rng(seed), order))


def circular():
    """Lesson a is for b, which comes before c, whose lesson is for d, which comes before a."""
    transfer = np.zeros((4, 4))
    transfer[0, 1] = transfer[2, 3] = 0.9
    problem = Problem(
        tuple("abcd"), np.full(4, 10.0), np.full(4, 100.0), np.full(4, 100.0), np.array([110.0, 1e3, 120.0, 1e3]),
        np.zeros(4), transfer, "any",
    )  # fmt: skip
    return replace(Shop.of_problem(problem), order="partial", before=np.array([[1, 2], [3, 0]]))


def test_lessons_that_wait_for_each_other_are_cut():
    """Free, both lessons pay (110 + 20 + 120 + 20); in a circle one of them has to go: c is handed over, d, too."""
    shop = circular()
    free = plan_shop(replace(shop, order="any", before=None))
    day = plan_shop(shop)
    assert free.objective == pytest.approx(270.0)
    assert day.objective == pytest.approx(110.0 + 20.0 + 200.0) == every_plan(shop)[0]
    assert len(day.certificate.leaf) == 3
    assert check_shop_plan(shop, day).optimal
    assert day.sequence.tolist().index(0) < day.sequence.tolist().index(1) < day.sequence.tolist().index(2)


def test_cases_that_are_no_circle_prove_nothing():
    shop = circular()
    day = plan_shop(shop)
    proof = day.certificate
    for change in (
        {"lesson": np.where(proof.lesson == 2, 0, proof.lesson)},
        {"group": np.where(proof.group == 3, 1, proof.group)},
        {"parent": np.array([-1, 0, 1])},
        {"parent": np.array([-1, 0]), "lesson": proof.lesson[:2], "group": proof.group[:2], "leaf": proof.leaf[:2]},
        {"leaf": (None, None, proof.leaf[2])},
    ):
        parts = {name: getattr(proof, name) for name in ("parent", "lesson", "group", "leaf")} | change
        with pytest.raises(SolverError, match="certificate"):
            check_shop_plan(shop, replace(day, certificate=ShopCertificate(**parts)))


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("arcs", [30, 60, 120])
def test_partial_orders_of_larger_shops_are_proven(seed, arcs):
    shop = large_shop(60, seed=seed, arcs=arcs)
    day = plan_shop(shop)
    assert day.status == "optimal"
    check_shop_plan(shop, day)
    ends = [plan_shop(replace(shop, order=order, before=None)).objective for order in ("any",)]
    assert ends[0] <= day.objective * (1 + 1e-9)


def test_a_total_order_is_the_fixed_one_and_none_is_any():
    for seed in range(5):
        shop = large_shop(12, seed=seed, counts=False)
        chain = np.stack([np.arange(11), np.arange(1, 12)], axis=1)
        total = plan_shop(replace(shop, order="partial", before=chain)).objective
        assert total == pytest.approx(plan(shop.problem()).objective, rel=1e-9)
        free = plan_shop(replace(shop, order="partial", before=np.zeros((0, 2)))).objective
        assert free == pytest.approx(plan(replace(shop.problem(), order="any")).objective, rel=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_copies_are_tasks_of_which_only_the_first_may_be_taught(seed):
    shop = large_shop(8, seed=seed, order="any")
    copies = np.repeat(np.arange(8), shop.count)
    is_first = np.concatenate([[True], copies[1:] != copies[:-1]])
    apart = Problem(
        tuple(str(i) for i in range(len(copies))), shop.c_rob[0, copies], shop.c_hum[copies], shop.c_fail[0, copies],
        np.where(is_first, shop.c_demo[0, copies], np.inf), np.zeros(len(copies)),
        shop.transfer[0][np.ix_(copies, copies)], "any",
    )  # fmt: skip
    assert plan_shop(shop).objective == pytest.approx(plan(apart).objective, rel=1e-9)


def test_two_robots_alike_cost_what_one_does():
    one = large_shop(30, seed=3)
    two = replace(
        one, robots=("left", "right"),
        **{name: np.repeat(getattr(one, name), 2, axis=0) for name in ("c_rob", "c_fail", "pretrained", "c_demo")},
        transfer=np.repeat(one.transfer, 2, axis=0),
    )  # fmt: skip
    assert plan_shop(two).objective == pytest.approx(plan_shop(one).objective, rel=1e-9)


@pytest.mark.parametrize("limit", ["max_lessons", "max_teaching"])
def test_limits_are_kept_and_proven(limit):
    shop = large_shop(150, 2, seed=1)
    free = plan_shop(shop)
    amount = (
        len(free.taught) // 2
        if limit == "max_lessons"
        else 0.4 * shop.c_demo[free.taught[:, 1], free.taught[:, 0]].sum()
    )
    tight = replace(shop, **{limit: float(amount)})
    day = plan_shop(tight)
    assert day.status == "optimal"
    assert check_shop_plan(tight, day).cost > free.objective
    with pytest.raises(ShapeError, match="more than its limits allow"):
        shop_outcome(tight, free.taught, free.sequence)
    with pytest.raises(SolverError, match="certificate"):  # what is proven within limits does not hold without
        check_shop_plan(shop, replace(day, status="optimal"))


def test_a_limit_that_does_not_bind_changes_nothing():
    shop = large_shop(40, seed=2)
    free = plan_shop(shop)
    loose = plan_shop(replace(shop, max_lessons=40.0, max_teaching=1e6))
    assert loose.objective == pytest.approx(free.objective, rel=1e-9)


def test_a_person_decides():
    shop = large_shop(20, seed=4, counts=False)
    shop = replace(shop, c_demo=shop.c_demo * 0.4)
    free = plan_shop(shop)
    taught = int(free.taught[0, 0])
    for choice, wanted in ((Ruling.ACT, 0), (Ruling.DELEGATE, 1), (Ruling.LEARN, 2)):
        decided = np.array(shop.choice)
        decided[[taught, 7]] = choice
        day = plan_shop(replace(shop, choice=decided))
        assert day.decision[[taught, 7]].tolist() == [wanted, wanted]
        assert day.objective >= free.objective * (1 - 1e-9)
    decided = np.array(shop.choice)
    decided[taught] = Ruling.NOT_LEARN
    assert plan_shop(replace(shop, choice=decided)).decision[taught] != Decision.LEARN


def test_what_cannot_be_kept_is_said():
    shop = large_shop(5, counts=False)
    with pytest.raises(ConfigError, match="no plan keeps the limits"):
        plan_shop(replace(shop, choice=np.full(5, Ruling.LEARN), max_lessons=2.0))
    with pytest.raises(ShapeError, match="in a circle: task 0 before task 1 before task 0"):
        replace(shop, order="partial", before=np.array([[0, 1], [1, 0]]))


def test_the_limit_that_cannot_be_kept_is_named():
    """Tasks 1 and 2 have no way but a lesson on themselves, each of 200; task 0 does not matter."""
    shop = replace(large_shop(3, counts=False), transfer=np.zeros((1, 3, 3)), c_demo=np.full((1, 3), 200.0))
    never = np.array([[10.0, np.inf, np.inf]])
    shop = replace(shop, c_hum=np.array([90.0, np.inf, np.inf]), c_rob=never)
    assert plan_shop(replace(shop, max_lessons=2.0, max_teaching=400.0)).status == "optimal"
    for lessons, teaching, fault in (
        (1.0, np.inf, "cannot be done within max_lessons=1;"),
        (1.0, 1000.0, "cannot be done within max_lessons=1;"),
        (2.0, 399.0, "cannot be done within max_teaching=399;"),
        (1.0, 399.0, "cannot be done within max_lessons=1 and max_teaching=399;"),
    ):
        with pytest.raises(ConfigError, match=fault):
            plan_shop(replace(shop, max_lessons=lessons, max_teaching=teaching))
    must = np.array([Ruling.FREE, Ruling.LEARN, Ruling.LEARN])
    with pytest.raises(ConfigError, match=r"2 tasks are to be taught .*, and max_lessons is 1;"):
        plan_shop(replace(shop, choice=must, max_lessons=1.0))
    with pytest.raises(ConfigError, match="the lessons to be given take 400 at least, and max_teaching is 399;"):
        plan_shop(replace(shop, choice=must, max_teaching=399.0))
    with pytest.raises(ConfigError, match="some task has no way"):
        plan_shop(replace(shop, choice=np.array([Ruling.FREE, Ruling.ACT, Ruling.FREE])))


def test_limits_that_only_together_cannot_be_kept_are_both_named():
    """One lesson (500) does for both tasks, and so do two (100 each): at most one lesson of at most 300 does not."""
    shop = replace(
        large_shop(2, counts=False), lessons=("all", "one", "other"), completes=np.array([-1, 0, 1]),
        c_demo=np.array([[500.0, 100.0, 100.0]]), c_hum=np.full(2, np.inf), c_fail=np.full((1, 2), np.inf),
        transfer=np.array([[[1.0, 1.0], [0.0, 0.0], [0.0, 0.0]]]),
    )  # fmt: skip
    assert plan_shop(replace(shop, max_lessons=1.0)).objective > 500.0
    assert plan_shop(replace(shop, max_teaching=300.0)).objective == 200.0
    with pytest.raises(ConfigError, match="within both max_lessons=1 and max_teaching=300;"):
        plan_shop(replace(shop, max_lessons=1.0, max_teaching=300.0))


def test_half_a_lesson_is_no_limit():
    with pytest.raises(ShapeError, match=r"max_lessons: 1.5 given; expected a whole number"):
        large_shop(3, max_lessons=1.5)


@pytest.mark.parametrize("seed", range(6))
def test_reasons_hold_on_either_side_of_the_break_even(seed):
    shop = large_shop(14, seed=seed)
    shop = replace(shop, c_demo=shop.c_demo * 0.6)
    day = plan_shop(shop)
    reasons = reasons_of(shop, day)
    assert reasons.unknown == 0
    assert len(reasons.lessons) == len(day.taught)

    def given_at(lesson, robot, cost):
        c_demo = shop.c_demo.copy()
        c_demo[robot, lesson] = cost
        return [lesson, robot] in plan_shop(replace(shop, c_demo=c_demo)).taught.tolist()

    for each in reasons.lessons:
        assert each.saving <= each.saving_others_fixed + 1e-6
        assert given_at(each.lesson, each.robot, each.stays_up_to * 0.999)
        assert not given_at(each.lesson, each.robot, each.stays_up_to * 1.001)
    for other in reasons.not_given[:3]:
        assert other.below < other.c_demo
        assert given_at(other.lesson, other.robot, other.below * 0.999)
        assert not given_at(other.lesson, other.robot, other.below * 1.001)


def test_without_lessons_nothing_is_saved():
    shop = large_shop(6, counts=False)
    dear = replace(shop, c_demo=shop.c_demo * 100)
    reasons = reasons_of(dear, plan_shop(dear))
    assert reasons.lessons == ()
    assert reasons.alone == pytest.approx(np.minimum(shop.c_hum, shop.c_rob[0] + shop.c_fail[0]).sum())


NO_TIME = 1e-6


def test_an_instance_is_not_made_beyond_its_deadline():
    with pytest.raises(TimeoutError):
        reduce_shop(large_shop(50, 2), deadline=0.0)


@pytest.mark.parametrize("order", ["fixed", "any", "partial"])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_without_time_plans_are_valid_and_bounds_true(order, seed):
    shop = small_shop(np.random.default_rng(seed), order)
    try:
        day = plan_shop(shop, time_limit_s=NO_TIME)
    except SolverError:
        return
    assert day.lower_bound <= every_plan(shop)[0] * (1 + 1e-9)
    assert check_shop_plan(shop, day).cost == pytest.approx(day.objective)


def test_without_time_a_large_shop_has_lessons_that_pay():
    shop = large_shop(400, 2, max_lessons=5.0)
    day = plan_shop(shop, time_limit_s=NO_TIME)
    alone = plan_shop(replace(shop, max_lessons=0.0)).objective
    assert day.status == "time_limit"
    assert 0 < len(day.taught) <= 5
    assert 0.0 < check_shop_plan(shop, day).bound <= day.objective < alone


def test_without_time_what_has_to_be_taught_is():
    """Nobody can do task 3 untaught, task 5 is to be taught, and the second robot cannot be."""
    shop = large_shop(30, 2, counts=False)
    c_hum, c_rob, c_demo = np.array(shop.c_hum), np.array(shop.c_rob), np.array(shop.c_demo)
    c_hum[3] = c_rob[:, 3] = c_demo[1] = np.inf
    choice = np.where(np.arange(30) == 5, Ruling.LEARN, Ruling.FREE)
    shop = replace(shop, c_hum=c_hum, c_rob=c_rob, c_demo=c_demo, choice=choice)
    day = plan_shop(shop, time_limit_s=NO_TIME)
    assert {3, 5} <= set(day.taught[:, 0].tolist())
    assert set(day.taught[:, 1].tolist()) == {0}
    check_shop_plan(shop, day)
    with pytest.raises(SolverError, match="no plan was found in time"):
        plan_shop(replace(shop, max_lessons=1.0), time_limit_s=NO_TIME)


@pytest.mark.parametrize("limit", [{"max_lessons": 2.0}, {"max_teaching": 500.0}])
def test_doctored_prices_of_a_limit_are_refused(limit):
    """Zeroed, they prove too little; raised, too little as well; negative ones are no prices at all."""
    shop = large_shop(60, seed=2, **limit)
    day = plan_shop(shop)
    (leaf,) = day.certificate.leaf
    assert leaf.prices.any()
    assert check_shop_plan(shop, day).optimal

    def doctored(prices):
        proof = replace(day.certificate, leaf=(replace(leaf, prices=prices),))
        check_shop_plan(shop, replace(day, certificate=proof))

    for change in (0.0, 0.5, 2.0, 10.0):
        with pytest.raises(SolverError, match="certificate: lower_bound is"):
            doctored(change * leaf.prices)
    with pytest.raises(ShapeError, match="prices"):
        doctored(-leaf.prices)
    with pytest.raises(SolverError, match="certificate: has prices of 2 limits; there are 1"):
        doctored(np.repeat(leaf.prices, 2, axis=1))
    with pytest.raises(SolverError, match="certificate"):  # they price a limit that there is not
        check_shop_plan(replace(shop, max_lessons=np.inf, max_teaching=np.inf), day)
