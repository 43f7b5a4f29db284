"""Laws of going back to moments of earlier successes."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_array_equal

from p2l.recoveries.chaining.learners import make_learner
from p2l.recoveries.chaining.mdp import Limits
from p2l.recoveries.chaining.pool import Pool
from p2l.recoveries.chaining.revisit import CAPACITY, Moments, Revisits
from p2l.skills.primitives import PRIMITIVES

ALIGN = len(PRIMITIVES)
BOTH = np.array([0, 1])


def test_an_episode_that_goes_back_goes_on_as_the_success_did(world, nominal, failures):
    """Same state, same history, same bounds; what follows is the same to the bit."""
    limits = Limits(decisions=4, history=2)
    given = iter(range(10_000))
    made = Pool(
        world,
        nominal,
        PRIMITIVES,
        lambda n: failures.take([next(given) % len(failures) for _ in range(n)]),
        1,
        limits,
        revisits=Revisits(1.0, 1, limits.decisions, np.random.default_rng(0)),
    )
    slot, paid = np.array([0]), False
    while not paid:
        seen = []
        for action in (4, ALIGN):
            seen.append(made.observation[0].copy())
            made.act(slot, np.array([action]))
            last = made.poll()
            if last.over[0]:
                break
        assert last.fresh[0]
        paid = last.reward[0] > 0.0
    again = set()
    for _ in range(12):
        state = made.observation[0].copy()
        depth = next(k for k, one in enumerate(seen) if np.array_equal(one, state))
        again.add(depth)
        for action in (4, ALIGN)[depth:]:
            made.act(slot, np.array([action]))
            told = made.poll()
        assert told.over[0]
        assert not told.fresh[0]
        assert_array_equal(told.observation, last.observation)
        assert_array_equal(told.steps, last.steps)
        assert told.reward[0] == 1.0
    assert again == {0, 1}
    while not np.array_equal(made.observation[0], seen[1]):  # one of the four decisions is spent there
        made.act(slot, np.array([ALIGN]))
        made.poll()
    for decision in (2, 3, 4):
        made.act(slot, np.array([4 if decision % 2 else 5]))
        told = made.poll()
        assert told.over[0] == (decision == 4)


def moments(world, decisions):
    count = len(decisions)
    none = np.zeros(count, dtype=np.int64)
    state = np.asarray(decisions, dtype=float)[:, None]
    rows = world.sample(np.random.default_rng(0), count)
    return Moments(rows, state, np.asarray(decisions), none, none.astype(bool))


def test_only_whole_ways_that_were_paid_are_kept(world):
    made = Revisits(1.0, 2, 3, np.random.default_rng(0))
    for decision in range(3):
        made.passing(BOTH, moments(world, [decision, decision]))
    made.ended(BOTH, np.array([False, False]))
    assert made.begin(BOTH)[1] is None
    made.passing(BOTH, moments(world, [0, 0]))
    made.passing(BOTH[:1], moments(world, [1]))
    made.ended(BOTH, np.array([True, False]))
    found = set()
    for _ in range(20):
        back, kept = made.begin(BOTH)
        assert_array_equal(made.fresh[back], False)
        found |= set(kept.decisions.tolist())
        made.ended(BOTH, np.array([False, False]))
    assert found == {0, 1}, "the third decision belonged to an earlier episode"


def test_moments_that_always_pay_make_room_and_what_is_learnt_makes_going_back_rare(world):
    made = Revisits(1.0, 2, 3, np.random.default_rng(0))
    made.passing(BOTH, moments(world, [0, 0]))
    made.ended(BOTH, np.array([True, False]))
    counts = []
    for _ in range(200):
        counts.append(len(made.begin(BOTH)[0]))
        made.ended(BOTH, np.array([True, True]))
    assert sum(counts[:20]) > 2 * sum(counts[-20:])
    assert np.isfinite(made._success).sum() <= CAPACITY


def test_a_whole_task_is_never_gone_on_with(task):
    learner, rng = make_learner("rc", task, Limits()), np.random.default_rng(0)
    assert learner.pool(task, rng, 2, 0.5)._revisits is not None
    assert replace(learner, whole_task=True).pool(task, rng, 2, 0.5)._revisits is None
