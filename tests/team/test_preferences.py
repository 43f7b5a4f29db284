"""A person whose costs are not known: laws of what is believed and of what a question is worth, and its oracle."""

import doctest
import itertools
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from p2l.errors import ConfigError, ShapeError, SolverError
from p2l.evaluation.style import png
from p2l.evaluation.team.preferences import preference_figure, preference_table
from p2l.team.preferences import (
    CostPrior,
    Kinds,
    Preferences,
    after_answer,
    ask,
    expected_shop,
    gamma_prior,
    listed_prior,
    lognormal_prior,
    next_question,
    possible_answers,
    question_values,
    record,
    values,
)
from p2l.team.preferences.dialogue import everything, most_uncertain, nothing, worth_most
from p2l.team.preferences.oracle import EveryPlan, every_answer
from p2l.team.preferences.people import KINDS, meetings, population, stranger
from p2l.team.preferences.values import Optima, open_families
from p2l.team.problem import Problem
from p2l.team.shop import Shop, plan_shop
from tests.team.shop_instances import small_shop
from tests.team.team_instances import problems

SEEDS = st.integers(0, 2**32 - 1)


def belief(rng, largest=4):
    k = int(rng.integers(1, largest))
    cost = np.sort(rng.choice(200, k, replace=False)).astype(float)
    return CostPrior(cost, rng.dirichlet(np.ones(k) * 2.0 + 0.01))


def believed(rng, n, families=2, noise=0.0, kinds=False):
    names = tuple(f"family {f}" for f in range(families))
    beliefs, common = tuple(belief(rng) for _ in names), None
    if kinds:
        given = tuple(rng.dirichlet(np.full(len(each.cost), 0.5), 3) for each in beliefs)
        common = Kinds(rng.dirichlet(np.ones(3)), given)
        together = (common.weight @ each for each in given)
        beliefs = tuple(CostPrior(one.cost, p / p.sum()) for one, p in zip(beliefs, together, strict=True))
    return Preferences(names, beliefs, rng.integers(-1, families, n), noise, common)


def instance(seed, order, noise=0.0, kinds=False):
    rng = np.random.default_rng(seed)
    shop = small_shop(rng, order)
    return shop, believed(rng, shop.n, noise=noise, kinds=kinds)


def day(tasks, transfer, c_demo, c_rob=10.0):
    """A thesis problem with the same costs for every task, failures at 100."""
    n = len(tasks)
    costs = {name: np.full(n, value) for name, value in (("c_rob", c_rob), ("c_hum", 50.0), ("c_fail", 100.0))}
    return Shop.of_problem(
        Problem(tasks, **costs, c_demo=np.full(n, c_demo), pretrained=np.zeros(n), transfer=np.array(transfer))
    )


def together():
    """A lesson of 80 does both tasks for 90; the person is better only if quick at both, 20 + 20."""
    half = CostPrior([20.0, 140.0], [0.5, 0.5])
    return day(("peg", "lid"), np.ones((2, 2)), 80.0), Preferences(("pegs", "lids"), (half, half), [0, 1])


# Beliefs


@pytest.mark.parametrize(("make", "law"), [(lognormal_prior, "lognorm"), (gamma_prior, "gamma")])
@pytest.mark.parametrize(("mean", "sd"), [(100.0, 55.0), (3.0, 0.01), (20.0, 60.0)])
def test_a_distribution_keeps_its_mean_and_each_point_is_the_mean_of_its_part(make, law, mean, sd):
    prior = make(mean, sd, 5)
    assert prior.mean == pytest.approx(mean, rel=1e-12)
    assert prior.variance < sd**2
    if law == "lognorm":
        s = np.sqrt(np.log1p((sd / mean) ** 2))
        of = stats.lognorm(s, scale=mean / np.sqrt(1 + (sd / mean) ** 2))
    else:
        of = stats.gamma((mean / sd) ** 2, scale=sd**2 / mean)
    edges = of.ppf(np.linspace(0, 1, 6))
    inner = [5 * of.expect(lambda x: x, lb=low, ub=high) for low, high in itertools.pairwise(edges[:-1])]
    assert prior.cost[:4] == pytest.approx(inner, rel=1e-5)


def test_a_distribution_without_spread_is_a_certainty_and_one_of_nothing_is_refused():
    assert lognormal_prior(7.0, 0.0).cost.tolist() == [7.0]
    assert gamma_prior(0.0, 0.0).cost.tolist() == [0.0]
    for mean, sd in ((-1.0, 1.0), (1.0, -1.0), (0.0, 1.0), (np.nan, 1.0)):
        with pytest.raises(ConfigError, match="at least 0"):
            lognormal_prior(mean, sd)
    with pytest.raises(ConfigError, match="points"):
        gamma_prior(1.0, 1.0, 0)


def test_listed_costs_come_in_any_order_and_without_the_impossible_ones():
    prior = listed_prior([140.0, 20.0, 9.0], [0.25, 0.75, 0.0])
    assert (prior.cost.tolist(), prior.probability.tolist(), prior.mean, prior.variance) == (
        [20.0, 140.0], [0.75, 0.25], 50.0, 2700.0,
    )  # fmt: skip
    for cost, chance in (([-1.0, 2.0], [0.5, 0.5]), ([1.0, 2.0], [0.5, 0.4]), ([1.0, 1.0], [0.5, 0.5]), ([], [])):
        with pytest.raises(ShapeError):
            listed_prior(cost, chance)


@settings(max_examples=150, deadline=None)
@given(SEEDS, st.sampled_from([0.0, 0.5, 20.0, 500.0]), st.booleans())
def test_beliefs_after_the_answers_average_to_those_of_today(seed, noise, kinds):
    preferences = believed(np.random.default_rng(seed), 1, 3, noise, kinds)
    for family in range(3):
        chance, after = possible_answers(preferences, family)
        assert chance.sum() == pytest.approx(1.0)
        for other, prior in enumerate(preferences.prior):
            mixed = sum(share * then.prior[other].probability for share, then in zip(chance, after, strict=True))
            assert mixed == pytest.approx(prior.probability, abs=1e-12)
            if other != family and not kinds:
                assert all(then.prior[other] is prior for then in after)


@settings(max_examples=50, deadline=None)
@given(SEEDS, st.sampled_from([0.0, 30.0]))
def test_what_two_answers_say_does_not_depend_on_which_came_first(seed, noise):
    """And it is Bayes' rule over every kind and every cost of the three families."""
    preferences = believed(np.random.default_rng(seed), 1, 3, noise, kinds=True)
    rng = np.random.default_rng(seed)
    said = [float(rng.choice(each.cost, p=each.probability)) for each in preferences.prior]
    one = after_answer(after_answer(preferences, 0, said[0]), 1, said[1])
    other = after_answer(after_answer(preferences, 1, said[1]), 0, said[0])
    weight = preferences.kinds.weight.copy()
    for family in (0, 1):
        cost = preferences.prior[family].cost
        edges = np.concatenate([[-np.inf], (cost[1:] + cost[:-1]) / 2, [np.inf]])
        at = int(np.flatnonzero(cost == said[family])[0])
        upper, lower = (stats.norm.cdf((edges[at + e] - cost) / noise) if noise else None for e in (1, 0))
        weight = weight * (preferences.kinds.given[family] @ (upper - lower if noise else np.arange(len(cost)) == at))
    weight = weight / weight.sum()
    assert one.kinds.weight == pytest.approx(weight, abs=1e-9)
    assert one.prior[2].probability == pytest.approx(weight @ preferences.kinds.given[2], abs=1e-9)
    for first, second in zip(one.prior, other.prior, strict=True):
        assert first.probability == pytest.approx(second.probability, abs=1e-9)


def test_one_answer_tells_the_kind_of_person_by_hand():
    """Quick people do either family for 20, slow ones for 140; who says 140 of pegs is slow at lids as well."""
    given = np.eye(2)
    prior = CostPrior([20.0, 140.0], [0.75, 0.25])
    before = Preferences(("pegs", "lids"), (prior, prior), [0, 1], kinds=Kinds([0.75, 0.25], (given, given)))
    assert after_answer(before, 0, 140.0).mean.tolist() == [140.0, 140.0]
    shop = day(("peg", "lid"), np.ones((2, 2)), 80.0)
    # Known by one answer: 90 - (0.75 · 40 + 0.25 · 90); with independent families, 100 or 190 by the person: 90 stays.
    assert question_values(shop, before, 0.0)[0].value == pytest.approx(90.0 - 52.5)
    alone = replace(before, kinds=None)
    assert question_values(shop, alone, 0.0)[0].value == pytest.approx(90.0 - 0.75 * 70.0 - 0.25 * 90.0)
    for wrong in ([0.5, 0.5], [1.0, 0.5]):
        with pytest.raises(ShapeError, match="kinds"):
            replace(before, kinds=Kinds(wrong, (given, given)))


def test_an_answer_with_noise_by_hand():
    """20 or 60, sd 20: an answer below 40 is 1 sd from the truth away, Φ(1) = 0.8413."""
    prior = CostPrior([20.0, 60.0], [0.5, 0.5])
    before = Preferences(("pegs",), (prior,), [0], noise=20.0)
    after = after_answer(before, 0, 31.0)
    assert after.prior[0].probability.tolist() == pytest.approx([0.841345, 0.158655], abs=1e-6)
    assert after_answer(after, 0, 55.0).prior[0].probability.tolist() == pytest.approx([0.5, 0.5])


def test_an_exact_answer_is_the_cost_and_a_closed_belief_holds_the_person_to_it():
    closed = Preferences(("pegs",), (CostPrior([20.0, 140.0], [0.5, 0.5]),), [0, 0])
    assert after_answer(closed, 0, 140.0).mean.tolist() == [140.0]
    with pytest.raises(ConfigError, match=r"'pegs': 50 is none of the costs.*\(20, 140\)"):
        after_answer(closed, 0, 50.0)
    opened = replace(closed, prior=(lognormal_prior(50.0, 20.0),))
    assert after_answer(opened, 0, 3.25).prior[0].cost.tolist() == [3.25]
    for no_cost in (-1.0, np.inf, np.nan):
        with pytest.raises(ConfigError, match="is no cost"):
            after_answer(opened, 0, no_cost)


def test_the_person_s_cost_is_believed_only_where_the_person_can_do_the_task():
    shop = replace(day(("a", "b", "c"), np.ones((3, 3)), 80.0), c_hum=[1.0, np.inf, 3.0])
    shop = expected_shop(shop, Preferences(("f",), (CostPrior([20.0, 40.0], [0.5, 0.5]),), [0, 0, -1]))
    assert shop.c_hum.tolist() == [30.0, np.inf, 3.0]


# The plan at the mean


@settings(max_examples=50, deadline=None)
@given(SEEDS, problems(largest=3, orders=("fixed",)))
def test_the_plan_at_the_mean_is_the_plan_of_least_expected_cost(seed, problem):
    """Every plan, every cost that the person may have: the mean over costs first, the least of plans then."""
    rng, n = np.random.default_rng(seed), problem.n
    preferences = believed(rng, n)
    worlds = list(itertools.product(*(range(len(each.cost)) for each in preferences.prior)))
    chance = [np.prod([p.probability[k] for p, k in zip(preferences.prior, w, strict=True)]) for w in worlds]
    costs = [np.array([p.cost[k] for p, k in zip(preferences.prior, w, strict=True)]) for w in worlds]
    c_hum = np.stack([np.where(preferences.member >= 0, c[preferences.member], problem.c_hum) for c in costs])
    attempts = problem.c_rob + (1.0 - problem.transfer) * problem.c_fail
    own = problem.c_rob + (1.0 - problem.pretrained) * problem.c_fail
    least = np.inf
    for ways in itertools.product(*([*range(i), "own", "person", "learn"] for i in range(n))):  # an int: a lesson on it
        if any(isinstance(way, int) and ways[way] != "learn" for way in ways):
            continue
        total = np.zeros(len(worlds))
        for i, way in enumerate(ways):
            by = {"own": own[i], "person": c_hum[:, i], "learn": problem.c_demo[i]}
            total = total + (attempts[way, i] if isinstance(way, int) else by[way])
        least = min(least, float(np.dot(chance, total)))
    shop = expected_shop(Shop.of_problem(problem), preferences)
    assert plan_shop(shop).objective == pytest.approx(least, rel=1e-9, abs=1e-9)


# What a question is worth


@settings(max_examples=100, deadline=None)
@given(SEEDS, st.sampled_from(["fixed", "any"]), st.sampled_from([0.0, 0.0, 30.0]), st.booleans())
def test_a_question_is_worth_what_every_plan_and_every_answer_say(seed, order, noise, kinds):
    shop, preferences = instance(seed, order, noise, kinds)
    try:
        worth = every_answer(shop, preferences, 0.0)
    except SolverError:  # nobody can do something
        return
    values = {each.family: each for each in question_values(shop, preferences, 3.0)}
    for family, expected in enumerate(worth.tolist()):
        assert values[family].value == pytest.approx(expected, rel=1e-6, abs=1e-5)
        assert values[family].value >= 0.0
        assert (values[family].ahead, values[family].slack) == (0.0, 0.0)


@settings(max_examples=20, deadline=None)
@given(SEEDS, st.booleans())
def test_looking_two_questions_ahead_is_worth_what_every_plan_and_every_answer_say(seed, kinds):
    shop, preferences = instance(seed, "fixed", kinds=kinds)
    try:
        worth = every_answer(shop, preferences, 2.0, 2)
    except SolverError:
        return
    for each in question_values(shop, preferences, 2.0, look_ahead=2):
        tells = kinds or each.family in open_families(shop, preferences)
        if tells and not preferences.prior[each.family].is_certain:
            assert each.value + each.ahead == pytest.approx(worth[each.family], rel=1e-6, abs=1e-5)


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_the_optimum_is_concave_in_a_cost_and_plans_in_between_are_not_missed(seed):
    shop, preferences = instance(seed, "fixed")
    optima, points = Optima(shop, preferences), np.array([90.0, 0.0, 30.0, 60.0, 120.0])
    try:
        value, _ = optima.along(preferences.mean, 0, points)
    except ConfigError:
        return
    order = np.argsort(points)
    slopes = np.diff(value[order]) / np.diff(points[order])
    assert (np.diff(slopes) <= 1e-7).all()
    assert (slopes >= -1e-9).all()
    plans = EveryPlan.of(shop)
    for point, found in zip(points, value, strict=True):
        cost = preferences.mean.copy()
        cost[0] = point
        assert found == pytest.approx(plans.least(preferences, cost), rel=1e-7, abs=1e-6)
        assert found == pytest.approx(optima.at(cost).plan.objective, rel=1e-7, abs=1e-6)


def test_noise_makes_an_answer_worth_less_and_one_without_use_is_worth_nothing():
    shop = day(("a", "b"), np.ones((2, 2)), 100.0)
    exact = Preferences(("f",), (CostPrior([20.0, 140.0], [0.5, 0.5]),), [0, 0])
    worths = [question_values(shop, replace(exact, noise=sd), 0.0)[0].value for sd in (0.0, 40.0, 80.0, 1e6)]
    assert worths[0] == pytest.approx(35.0)
    assert worths == sorted(worths, reverse=True)
    assert worths[-1] == 0.0
    cheap = replace(exact, prior=(CostPrior([1.0, 3.0], [0.5, 0.5]),))
    assert question_values(shop, cheap, 0.0)[0].value == 0.0
    assert question_values(shop, replace(exact, member=[-1, -1]), 0.0)[0].value == 0.0


def test_more_points_of_a_distribution_never_make_a_question_worth_less_by_much():
    shop = day(("a", "b"), np.ones((2, 2)), 100.0)
    worth = [
        question_values(shop, Preferences(("f",), (lognormal_prior(80.0, 60.0, k),), [0, 0]), 0.0)[0].value
        for k in (1, 2, 4, 8, 16, 64)
    ]
    assert worth == sorted(worth)  # halving the parts tells more
    of = stats.lognorm(np.sqrt(np.log1p(0.75**2)), scale=80.0 / np.sqrt(1 + 0.75**2))
    truth = 110.0 - of.expect(lambda c: np.minimum(2.0 * c, 110.0), epsabs=1e-10)
    assert worth[-1] <= truth + 1e-6
    assert worth[-1] == pytest.approx(truth, abs=0.1)


def test_two_questions_that_only_pay_together_are_missed_by_one_step_and_found_by_two():
    shop, preferences = together()
    assert [each.value for each in question_values(shop, preferences, 5.0)] == [0.0, 0.0]
    assert next_question(shop, preferences, 5.0) is None
    ahead = question_values(shop, preferences, 5.0, look_ahead=2)
    # Both quick with 1/4: 90 - 40 is saved. The second question is asked with 1/2: 50/4 - 5/2 = 10.
    assert [each.ahead for each in ahead] == pytest.approx([10.0, 10.0])
    assert ahead[0].net(5.0) == pytest.approx(5.0)
    optima = Optima(shop, preferences)
    done = ask(shop, preferences, 5.0, lambda _: 20.0, worth_most(optima, 5.0, look_ahead=2))
    assert (done.asked, done.spent, done.plan.objective) == ((0, 1), 10.0, 40.0)
    slow = ask(shop, preferences, 5.0, lambda _: 140.0, worth_most(optima, 5.0, look_ahead=2))
    assert (slow.asked, slow.plan.objective) == ((0,), 90.0)


@pytest.mark.parametrize("module", [record, values])
def test_the_examples_run(module):
    assert doctest.testmod(module).attempted > 1
    assert doctest.testmod(module).failed == 0


def test_refusals():
    shop, preferences = together()
    for words in ({"c_ask": -1.0}, {"c_ask": np.nan}, {"c_ask": 1.0, "look_ahead": 4}):
        with pytest.raises(ConfigError, match=list(words)[-1]):
            question_values(shop, preferences, **words)
    for wrong in ({"families": ("f", "f")}, {"families": ("f",)}, {"member": [0, 2]}, {"noise": -1.0}):
        with pytest.raises(ShapeError):
            replace(preferences, **wrong)


# Asking


def three():
    """Pegs are many, lids are few and as uncertain, pins are known."""
    shop = day(tuple("abcdef"), np.eye(6) + 0.9 * (np.ones((6, 6)) - np.eye(6)), 150.0)
    wide, sure = CostPrior([10.0, 90.0], [0.5, 0.5]), CostPrior([50.0], [1.0])
    return shop, Preferences(("lid", "peg", "pin"), (wide, wide, sure), [0, 1, 1, 1, 1, 2])


def test_what_is_asked_first_is_worth_most_and_asking_stops():
    shop, preferences = three()
    truth = [90.0, 10.0, 50.0]
    done = ask(shop, preferences, 8.0, truth.__getitem__)
    values = question_values(shop, preferences, 8.0)
    assert values[0].family == done.asked[0] == 1
    assert done.answers[0] == 10.0
    assert done.spent == 8.0 * len(done.asked)
    assert next_question(shop, done.preferences, 8.0) is None
    assert done.expected_cost == pytest.approx(done.plan.objective + done.spent)
    assert ask(shop, preferences, 1000.0, truth.__getitem__).asked == ()


def test_other_policies_ask_what_they_say():
    shop, preferences = three()
    said = [90.0, 10.0, 50.0].__getitem__
    assert ask(shop, preferences, 8.0, said, nothing()).asked == ()
    assert ask(shop, preferences, 8.0, said, everything(shop)).asked == (0, 1, 2)
    assert ask(shop, preferences, 8.0, said, most_uncertain(shop, 1)).asked == (0,)
    assert ask(shop, preferences, 8.0, said, most_uncertain(shop, 9)).asked == (0, 1, 2)
    none = replace(shop, c_hum=np.where(preferences.member == 0, np.inf, shop.c_hum))
    assert ask(none, preferences, 8.0, said, everything(none)).asked == (1, 2)


@settings(max_examples=20, deadline=None)
@given(SEEDS)
def test_asking_is_worth_its_cost_on_average_over_all_people(seed):
    """By what is believed: over all costs of the person, ours is never above asking nothing."""
    shop, preferences = instance(seed, "fixed")
    try:
        stay = ask(shop, preferences, 2.0, lambda _: 0.0, nothing()).plan.objective
    except ConfigError:
        return
    optima, total = Optima(shop, preferences), 0.0
    for world in itertools.product(*(range(len(each.cost)) for each in preferences.prior)):
        pairs = list(zip(preferences.prior, world, strict=True))
        truth = np.array([each.cost[k] for each, k in pairs])
        done = ask(shop, preferences, 2.0, truth.__getitem__, optima=optima)
        total += np.prod([each.probability[k] for each, k in pairs]) * (
            optima.at(done.preferences.mean).at(truth) + done.spent
        )
    assert total <= stay + 1e-6


# Made-up people


def test_people_are_drawn_as_their_kinds_say_and_the_belief_is_that_of_all_together():
    rng, drawn = np.random.default_rng(1), []
    for kind in KINDS:
        costs = kind.costs(20_000, rng)
        mean = sum(share * m for share, m, _ in kind.parts)
        assert costs.mean() == pytest.approx(mean, rel=0.03)
        assert (costs < 60.0).mean() == pytest.approx(float(kind.below(np.array([60.0]), 0)[0]), abs=0.01)
        assert costs[costs < 60.0].sum() / 20_000 == pytest.approx(float(kind.below(np.array([60.0]), 1)[0]), abs=0.5)
        drawn.append(costs)
    assert (np.mean(drawn), np.std(drawn)) == pytest.approx(population(), rel=0.02)
    assert population() == pytest.approx((100.0, 54.5122), rel=1e-6)
    believed_of = stranger(np.array([0, 1]), ("a", "b"), 8)
    assert believed_of.mean.tolist() == pytest.approx([100.0, 100.0], abs=1e-9)
    assert believed_of.prior[0].probability == pytest.approx(np.full(8, 0.125), abs=1e-3)
    assert after_answer(believed_of, 0, 20.0).kinds.weight == pytest.approx([0.0, 1.0, 0.0], abs=1e-5)
    assert after_answer(believed_of, 0, 20.0).mean[1] == pytest.approx(50.0, abs=3.0)


def test_meetings_add_up_by_hand():
    """A person who is quick at both families; the lesson truly fails every other time."""
    shop, preferences = together()
    true = replace(shop, transfer=np.full((1, 2, 2), 0.5))
    found = {met.policy: met for met in meetings(Optima(shop, preferences), true, np.array([20.0, 20.0]), 5.0)}
    assert {name: met.questions for name, met in found.items()} == {
        "nothing": 0, "everything": 2, "worth": 0, "worth_alone": 0, "known": 0, "uncertain": 0,
    }  # fmt: skip
    assert found["everything"].plan_cost == found["known"].plan_cost == 40.0
    assert found["nothing"].plan_cost == found["worth"].plan_cost == 80.0 + 10.0 + 0.5 * 100.0


def test_the_table_pairs_people_of_a_set_and_says_where_ours_is_cheaper():
    rows = [
        {"domain": "d", "regime": "r", "c_ask": 5.0, "set": at, "kind": kind, "person": 0, "policy": policy,
         "questions": asked, "plan_cost": 100.0 + 10.0 * at + more}
        for at in range(4) for kind in ("k", "l")
        for policy, asked, more in (("nothing", 0, 12.0 + at), ("worth", 1, 0.0))
    ]  # fmt: skip
    table = preference_table(pd.DataFrame(rows))
    assert table["kind"].tolist() == ["k", "k", "l", "l", "all", "all"]
    whole = table[(table["kind"] == "all") & (table["policy"] == "nothing")].iloc[0]
    assert (whole["people"], whole["sets"], whole["total"]) == (8, 4, 128.5)
    assert whole["minus"] == pytest.approx(np.mean([-7.0, -8.0, -9.0, -10.0]))
    half = stats.t.ppf(0.975, 3) * np.std([7, 8, 9, 10], ddof=1) / 2
    assert (whole["minus_low"], whole["minus_high"]) == pytest.approx((-8.5 - half, -8.5 + half))
    assert png(preference_figure(table, 5.0, "r"))[:4] == b"\x89PNG"
