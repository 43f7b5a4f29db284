"""Trajectories out of slots that decide at their own pace."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from p2l.chaining.mdp import Transitions
from p2l.chaining.rollout import Gatherer


def told(slot, number, *, over=False, cut=False):
    """One decision has played out; its number is its reward."""
    one, state = np.array([slot]), np.full((1, 2), float(number))
    flags = [np.array([flag]) for flag in (False, over, True, cut)]
    return Transitions(one, state, np.array([float(number)]), *flags, one, state)


def decide(gathered, slot, number):
    gathered.decide(np.array([slot]), np.full((1, 2), -float(number)), *[np.array([number])] * 3)


def test_decisions_are_grouped_by_slot_and_only_the_end_of_the_rollout_leaves_one_open():
    gathered = Gatherer()
    plan = [(1, 0, {}), (0, 1, {}), (1, 2, {"over": True}), (0, 3, {"over": True, "cut": True}), (1, 4, {}), (0, 5, {})]
    for slot, number, flags in plan:
        decide(gathered, slot, number)
        gathered.add(told(slot, number, **flags))
    first = gathered.take(5)
    assert_array_equal(first.slot, [0, 0, 1, 1, 1])
    assert_array_equal(first.action, [1, 3, 0, 2, 4])
    assert_array_equal(first.head, [True, False, True, False, True])
    assert_array_equal(first.open_end, [False, False, False, False, True])
    assert_array_equal(first.after[:, 0], first.reward)
    assert_array_equal(gathered.take(1).action, [5])


@settings(max_examples=40)
@given(st.lists(st.tuples(st.integers(0, 3), st.booleans()), min_size=1, max_size=60), st.integers(1, 7))
def test_every_decision_is_taken_once_with_what_it_was_chosen_on(plan, size):
    gathered, taken = Gatherer(), []
    for number, (slot, over) in enumerate(plan):
        decide(gathered, slot, number)
        gathered.add(told(slot, number, over=over))
        if len(gathered) >= size:
            taken.append(gathered.take(size))
    found = np.concatenate([part.action for part in taken]) if taken else np.zeros(0)
    assert_array_equal(np.sort(found), np.arange(len(plan) // size * size))
    for part in taken:
        assert_array_equal(part.action, part.reward)
        assert_array_equal(part.observation[:, 0], -part.reward)
        over = np.array([plan[k][1] for k in part.action])
        assert_array_equal(part.head[1:], (np.diff(part.slot) != 0) | over[:-1])
        assert not part.open_end[over].any()
