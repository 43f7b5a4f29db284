"""Laws of going back to moments of earlier successes."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from p2l.recoveries.chaining.learner import Task
from p2l.recoveries.chaining.learners import make_learner
from p2l.recoveries.chaining.mdp import Limits
from p2l.recoveries.chaining.pool import Pool
from p2l.recoveries.chaining.revisit import CAPACITY, ENOUGH, RECENT, Moments, Revisits
from p2l.skills.primitives import PRIMITIVES, STEPS

ALIGN = len(PRIMITIVES)
BOTH, FIRST, SECOND = np.array([0, 1]), np.array([0]), np.array([1])
YES, NO = np.array([True]), np.array([False])


@pytest.fixture
def made(world, nominal, failures):
    """One slot; a success is gone back to as often as may be."""
    limits = Limits(decisions=9, primitive_steps=3 * STEPS, history=2)
    given = iter(range(10_000))
    return Pool(
        world,
        nominal,
        PRIMITIVES,
        lambda n: failures.take([next(given) % len(failures) for _ in range(n)]),
        1,
        limits,
        revisits=Revisits(1.0, 1, limits.decisions, np.random.default_rng(0)),
    )


def succeed(made):
    """States before a primitive and an option that together are paid, and what came of the option."""
    while True:
        seen = []
        for action in (4, ALIGN):
            seen.append(made.observation[0].copy())
            made.act(FIRST, np.array([action]))
            last = made.poll()
            if last.over[0]:
                break
        if last.reward[0] > 0.0:
            return seen, last


def fail(made):
    """To and fro until the episode is over."""
    over, action = False, 4
    while not over:
        made.act(FIRST, np.array([action]))
        over, action = made.poll().over[0], 9 - action


def test_an_episode_that_goes_back_goes_on_as_the_success_did(made):
    """Same state, same history; what follows is the same to the bit."""
    seen, last = succeed(made)
    assert last.fresh[0]
    again = set()
    for _ in range(12):
        while made._revisits.fresh[0]:
            fail(made)
        state = made.observation[0]
        depth = next(k for k, one in enumerate(seen) if np.array_equal(one, state))
        again.add(depth)
        for action in (4, ALIGN)[depth:]:
            made.act(FIRST, np.array([action]))
            told = made.poll()
        assert told.over[0]
        assert not told.fresh[0]
        assert_array_equal(told.observation, last.observation)
        assert_array_equal(told.steps, last.steps)
        assert told.reward[0] == 1.0
    assert again == {0, 1}


def test_what_was_spent_before_counts_for_the_bounds(made):
    seen, _ = succeed(made)
    while not np.array_equal(made.observation[0], seen[1]):
        fail(made)
    for primitive in (2, 3):  # one of three has been spent on the way there
        made.act(FIRST, np.array([4 if primitive % 2 else 5]))
        told = made.poll()
        assert told.over[0] == (primitive == 3)


def test_an_unsimulated_pay_is_believed_but_not_kept(made):
    told = made.settle(FIRST, np.ones(1))
    assert told.fresh[0]
    for _ in range(5):
        assert made.settle(FIRST, np.zeros(1)).fresh[0], "there is nothing to go back to"


def test_a_reset_starts_at_failures(made):
    succeed(made)
    while made._revisits.fresh[0]:
        fail(made)
    made.reset()
    made.act(FIRST, np.array([ALIGN]))
    assert made.poll().fresh[0]


def moments(world, decisions, tag=0.0):
    """At decision numbers [K]; their state says which they are."""
    decisions = np.asarray(decisions)
    none = np.zeros(len(decisions), dtype=np.int64)
    rows = world.sample(np.random.default_rng(0), 1).take(none)
    return Moments(rows, decisions[:, None] + tag, decisions, none, none.astype(bool))


def paid_once(world, made, tag):
    """A way of two decisions, whose moments' states are `tag` and `tag + 1`."""
    made.forget(FIRST)
    for decision in range(2):
        made.passing(FIRST, moments(world, [decision], tag))
    made.ended(FIRST, YES)


def filled(world, slots):
    """Every place is taken: the moment in place p has state p."""
    made = Revisits(1.0, slots, 2, np.random.default_rng(0))
    for tag in range(0, CAPACITY, 2):
        paid_once(world, made, float(tag))
    return made


def test_only_whole_ways_that_were_paid_are_kept(world):
    made = Revisits(1.0, 2, 3, np.random.default_rng(0))
    for decision in range(3):
        made.passing(BOTH, moments(world, [decision, decision], 0.25))
    made.ended(BOTH, np.array([False, False]))
    assert made.begin(BOTH)[1] is None
    made.passing(FIRST, moments(world, [0], 0.5))
    made.passing(SECOND, moments(world, [0], 0.75))
    made.passing(FIRST, moments(world, [1], 0.5))
    made.ended(BOTH, np.array([True, False]))
    found = set()
    for _ in range(40):
        made._recent[:] = 0.0
        back, kept = made.begin(FIRST)
        if len(back):
            found.add(float(kept.state[0, 0]))
            made.passing(back, moments(world, [2], 0.125))
            made.ended(back, kept.decisions == 1)  # well, but not from the failure on
    assert found == {0.5, 1.5}


def test_a_single_decision_leaves_nothing_to_go_back_to(world):
    made = Revisits(1.0, 1, 2, np.random.default_rng(0))
    made.passing(FIRST, moments(world, [0]))
    made.ended(FIRST, YES)
    assert made.begin(FIRST)[1] is None


def test_moments_that_pay_most_often_make_room(world):
    made, often = filled(world, 1), [7, 30]
    made._success[[*often, 8]] = 0.9, 0.8, 0.1
    before = made._success.copy()
    paid_once(world, made, 1000.0)
    assert_array_equal(np.flatnonzero(made._success != before), often)
    assert_array_equal(made._kept.state[often, 0], [1000.0, 1001.0])


def test_moments_that_sometimes_pay_are_preferred(world):
    made = Revisits(1.0, 1, 2, np.random.default_rng(0))
    for tag in (0.0, 2.0):
        paid_once(world, made, tag)
    made._recent[:] = 0.0
    made._success[:4] = 0.02, 0.5, 0.98, np.inf
    counts = np.zeros(3)
    for _ in range(600):
        counts[int(made.begin(FIRST)[1].state[0, 0])] += 1
    assert counts[1] > 3 * max(counts[0], counts[2]) > 0


def test_the_moment_of_an_episode_under_way_may_be_overwritten(world):
    made = filled(world, 2)
    made._recent[:] = 0.0
    back, kept = made.begin(SECOND)
    place = int(kept.state[0, 0])
    made._success[place] = 0.99
    paid_once(world, made, 1000.0)
    assert made._kept.state[place, 0] == 1000.0
    assert not made.fresh[back].any()
    made.ended(SECOND, NO)
    assert made._success[place] == 0.5, "what came of the old moment says nothing about the new one"


def test_every_episode_from_a_moment_counts(world):
    made = Revisits(1.0, 2, 2, np.random.default_rng(0))
    paid_once(world, made, 0.0)
    made._success[1] = np.inf  # one place is left to go back to
    made._recent[:] = 0.0
    while len(made.begin(BOTH)[0]) < 2:
        pass
    made.ended(BOTH, np.array([True, False]))
    assert made._success[0] == pytest.approx((0.5 + 0.3 * 0.5) * 0.7)


def test_a_moment_learns_from_pay_that_was_not_simulated(world):
    made = filled(world, 1)
    made._recent[:] = 0.0
    _, kept = made.begin(FIRST)
    made.ended(FIRST, YES, simulated=False)
    assert made._success[int(kept.state[0, 0])] == pytest.approx(0.5 + 0.3 * 0.5)


@pytest.mark.parametrize(("recent", "share"), [(0.0, 1.0), (ENOUGH / 2, 0.5), (ENOUGH, 0.0), (1.0, 0.0)])
def test_what_is_learnt_ends_going_back(world, recent, share):
    made = filled(world, 1)
    made._recent[: round(recent * RECENT)], made._recent[round(recent * RECENT) :] = 1.0, 0.0
    back = sum(len(made.begin(FIRST)[0]) for _ in range(400))
    assert back == pytest.approx(400 * share, abs=50)


def test_a_whole_task_is_never_gone_on_with(task: Task):
    learner, rng = make_learner("rc", task, Limits()), np.random.default_rng(0)
    assert learner.pool(task, rng, 2, 0.5)._revisits is not None
    assert replace(learner, whole_task=True).pool(task, rng, 2, 0.5)._revisits is None
