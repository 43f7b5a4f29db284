"""Where recoveries hand control back: on the small push world, and strategies in the bread's bin."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_array_equal

from examples.push.world import Push
from p2l.chaining.agent import Agent
from p2l.chaining.execute import nominal_part, recover
from p2l.chaining.mdp import Limits
from p2l.chaining.novelty import StateSet
from p2l.chaining.reuse import Novel, last_decisions, most_novel, nominal_sets, of_rows, reuse_rows
from p2l.chaining.strategies import strategy
from p2l.evaluation.chaining.reuse import figure_5_9, novel_starts
from p2l.evaluation.chaining.strategies import strategies_5
from p2l.evaluation.thesis import load_thesis
from p2l.skills.primitives import PRIMITIVES
from p2l.skills.runner import Reason
from p2l.worlds.table import make_world

BACK, ALIGN = 1, len(PRIMITIVES)


@pytest.fixture(scope="module")
def push():
    world = Push(nthread=1, sigma_m=0.03)
    return world, world.nominal_options()


@pytest.fixture(scope="module")
def failures(push):
    plain = nominal_part(*push, push[0].sample(np.random.default_rng(0), 30))
    return plain.last.rows.take(plain.last.reason == Reason.FAILURE)


def doing(*actions):
    """An agent that goes through `actions`, whatever it sees."""
    left = iter(actions)
    return Agent(Limits(), PRIMITIVES, lambda seen: np.full(len(seen), next(left)))


def test_the_last_decision_is_taken_where_the_one_before_has_led(push, failures):
    one = failures.take([0])
    at_once, now = last_decisions(*push, doing(ALIGN), one)
    assert_array_equal(now.states, one.states)
    kept = []
    found, moment = last_decisions(*push, doing(BACK, BACK, ALIGN), one)
    recover(*push, doing(BACK, BACK, ALIGN), one, lambda _, rows: kept.append(rows))
    assert (found.actions[0] >= 0).sum() == 3
    ends = [rows for rows in kept if rows.actions[0] == one.actions[0] + 2]
    assert_array_equal(moment.states, ends[0].states)
    assert at_once.actions[0, 0] == ALIGN


def test_the_most_novel_start_is_the_farthest_that_paid():
    rows = {"learner": "rc", "seed": [0, 0, 1, 1], "option": ["push", "align", "push", ""]}
    reuse = pd.DataFrame({**rows, "success": [True, False, True, True], "off_begun": [1.5, 9.0, 2.5, np.nan]})
    assert most_novel(reuse) == Novel("rc", 1, 0, "push", 2.5)
    assert most_novel(reuse.assign(off_begun=1.0)) is None
    assert most_novel(reuse.iloc[:0]) is None


def test_states_are_outside_beyond_what_nominal_runs_leave_between_each_other():
    values, episode = np.linspace(0.0, 1.0, 200)[:, None], np.arange(200) // 5
    known = StateSet.of(values, episode)
    assert (known.off(values) <= 1.0).mean() > 0.98
    assert_array_equal(known.off(np.array([[0.5], [2.0], [-1.0]])) > 1.0, [False, True, True])
    assert StateSet.of(values[:10], episode[:10]) is None  # two runs


def test_nominal_runs_are_inside_and_failures_are_not(push, failures):
    world, nominal = push
    sets = nominal_sets(world, nominal, world.sample(np.random.default_rng(1), 60))
    fresh = world.sample(np.random.default_rng(2), 40)
    assert (sets.off(0, "begun", of_rows(world, fresh)) > 1.0).mean() <= 0.15
    assert (sets.off(1, "begun", of_rows(world, failures)) > 1.0).mean() > 0.5
    agent = Agent(Limits(), PRIMITIVES, lambda seen: np.full(len(seen), ALIGN))
    rows = reuse_rows(world, nominal, agent, failures, sets)
    assert set(rows["option"]) == {"align"}
    assert_array_equal(rows["success"], recover(world, nominal, agent, failures).success)
    assert set(rows["strategy"]) == {"at_once"}
    never = reuse_rows(world, nominal, doing(*[BACK] * 10), failures.take([0]), sets)
    assert never[["option", "strategy"]].iloc[0].tolist() == ["", "unnamed"]


def test_a_turned_hand_and_bread_that_is_farther_from_the_wall_are_told_apart():
    plain = make_world("pick_place", {})
    world, nominal = plain, plain.nominal_options()
    start = world.sample(np.random.default_rng(3), 1)
    turn = next(k for k, primitive in enumerate(PRIMITIVES) if primitive.name == "turn +z")
    turned = last_decisions(world, nominal, doing(turn, ALIGN), start)[1]
    twice = last_decisions(world, nominal, doing(turn, turn, ALIGN), start)[1]
    assert strategy(world, start, turned, np.array([1])) == ["turn"]
    assert strategy(world, start, twice, np.array([2])) == ["other"]
    assert strategy(world, start, start, np.array([0])) == ["at_once"]
    place = world.engine.sensor_columns["object_pos"]
    near, far, held = (one.take([0]) for one in (start, start, start))
    near.sensors[:, place], far.sensors[:, place] = (0.1, -0.45, 0.84), (0.1, -0.43, 0.84)
    held.sensors[:, place] = (0.1, -0.40, 1.0)
    assert strategy(world, near, far, np.array([1])) == ["push"]
    assert strategy(world, far, near, np.array([1])) == ["other"]
    assert strategy(world, near, held, np.array([1])) == ["other"]
    assert strategy(world, near, far.take([0]), np.array([2])) == ["push"]


def test_shares_and_pay_are_counted_of_what_they_are_shares_of():
    thesis = load_thesis("data/thesis", 5)
    rows = [
        ("place", True, "up", 2.0),
        ("place", False, "up", 2.0),
        ("place", True, "inside", 0.5),
        ("", True, "up", None),
    ]
    reuse = pd.DataFrame(rows, columns=["option", "success", "strategy", "off_visited"])
    reuse = reuse.assign(off_begun=reuse["off_visited"], learner="rc", seed=0, primitives=1)
    cells = figure_5_9("shelf", reuse, thesis).set_index(["setting", "metric"])["mean"]
    assert cells["world=shelf;option=place", "outside_visited"] == 2 / 3
    assert cells["world=shelf;option=any", "pays_outside_visited"] == 1 / 2
    assert cells["world=shelf;option=any", "pays_inside_begun"] == 1.0
    shares = strategies_5("shelf", reuse, thesis).set_index(["setting", "metric"])["mean"]
    assert shares["world=shelf;strategy=up", "share"] == 2 / 3
    assert shares["world=shelf;strategy=up", "recovery"] == 2 / 3
    assert shares["world=shelf;strategy=inside", "recovery"] == 1.0
    assert len(novel_starts(figure_5_9("shelf", reuse, thesis), "shelf").axes) == 2
    assert len(figure_5_9("shelf", reuse.iloc[:0], thesis)) == 0
