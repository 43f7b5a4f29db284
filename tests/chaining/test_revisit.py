"""Laws of going back to moments of earlier successes."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from p2l.chaining import revisit
from p2l.chaining.learner import ChainTask
from p2l.chaining.learners.table import make_learner
from p2l.chaining.mdp import Limits
from p2l.chaining.pool import Pool
from p2l.chaining.revisit import ENOUGH, MANY, RECENT, RevisitMoments, Revisits
from p2l.skills.primitives import PRIMITIVES, STEPS

ALIGN = len(PRIMITIVES)
BOTH, FIRST, SECOND = np.array([0, 1]), np.array([0]), np.array([1])
YES, NO = np.array([True]), np.array([False])


@pytest.fixture
def few(monkeypatch):
    """One failure with a way is as good as many."""
    monkeypatch.setattr(revisit, "MANY", 1)


@pytest.fixture
def made(few, world, nominal, failures):
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


def moments(world, decisions, failure, tag=0.0):
    """At decision numbers [K] of an episode from `failure`; the state's columns say which they are, and whose."""
    decisions = np.asarray(decisions)
    none = np.zeros(len(decisions), dtype=np.int64)
    rows = world.sample(np.random.default_rng(0), 1).take(none)
    state = np.stack([decisions.astype(float), none + float(failure), np.where(decisions > 0, tag, 0.0)], axis=1)
    return RevisitMoments(rows, state, decisions, none, none.astype(bool))


def play(world, made, failure, decisions, paid=YES, tag=0.0, **told):
    """An episode in slot 0 that starts at `failure` and takes so many decisions."""
    made.forget(FIRST)
    for decision in range(decisions):
        made.record(FIRST, moments(world, [decision], failure, tag))
    made.end(FIRST, paid, **told)
    made._recent[:] = 0.0


def again(made, slots=FIRST):
    """The state at the moment of the next episode that goes back, in the first of `slots`."""
    while True:
        back, kept = made.begin(slots)
        if len(back):
            return kept.state[0]


@pytest.fixture
def one(few):
    """One slot, all of whose episodes go back if they can."""
    return Revisits(1.0, 1, 4, np.random.default_rng(0))


def test_only_whole_ways_that_were_paid_are_kept(world, one):
    play(world, one, 1, 3, NO)
    assert one.begin(FIRST)[1] is None
    play(world, one, 2, 2)
    found = set()
    for _ in range(40):
        number, failure, _ = again(one)
        found.add((number, failure))
        one.record(FIRST, moments(world, [2], failure))
        one.end(FIRST, np.array([number == 1]))  # well, but not from the failure on
    assert found == {(0, 2), (1, 2)}


def test_a_single_decision_leaves_nothing_to_go_back_to(world, one):
    play(world, one, 1, 3)
    play(world, one, 1, 1)
    assert one.begin(FIRST)[1] is None
    play(world, one, 1, 2)
    assert one.begin(FIRST)[1] is None, "the failure is known to be easy"


def test_a_shorter_way_takes_the_place_of_a_longer_one(world, one):
    for decisions, tag in ((3, 0.25), (2, 0.5), (2, 0.75), (4, 0.875)):
        play(world, one, 1, decisions, tag=tag)
    found = {tuple(again(one)) for _ in range(40)}
    assert found == {(0, 1, 0), (1, 1, 0.5)}


def test_every_failure_has_its_own_way_however_often_it_was_paid(world, one):
    for _ in range(20):
        play(world, one, 1, 2)
    play(world, one, 2, 2)
    for failure in one._failures.values():
        failure.success = 0.0
    counts = np.bincount([int(again(one)[1]) for _ in range(400)], minlength=3)
    assert counts[2] == pytest.approx(200, abs=50)


def test_failures_whose_recovery_succeeds_are_left_alone(world, one):
    for failure in (1, 2):
        play(world, one, failure, 2)
    for _ in range(20):
        play(world, one, 1, 2)
        play(world, one, 2, 2, NO)
    counts = np.bincount([int(again(one)[1]) for _ in range(400)], minlength=3)
    assert 0 < counts[1] < 20


def test_moments_that_sometimes_pay_are_preferred(world, one):
    play(world, one, 1, 3)
    next(iter(one._failures.values())).way.success[:] = 0.02, 0.5, 0.98
    counts = np.bincount([int(again(one)[0]) for _ in range(600)], minlength=3)
    assert counts[1] > 3 * max(counts[0], counts[2]) > 0


def test_a_moment_learns_from_every_episode_and_a_failure_only_from_its_own(world, few):
    made = Revisits(1.0, 2, 2, np.random.default_rng(0))
    play(world, made, 1, 2)
    way = next(iter(made._failures.values())).way
    made._episodes = [replace(episode, way=way, moment=0) for episode in made._episodes]
    assert not made.fresh.any()
    made.end(BOTH, np.array([True, False]))
    assert way.success[0] == pytest.approx((0.5 + 0.3 * 0.5) * 0.7)
    assert next(iter(made._failures.values())).success == pytest.approx(0.3)


def test_pay_that_was_not_simulated_counts_but_leaves_no_way(world, one):
    play(world, one, 1, 2, simulated=False)
    (failure,) = one._failures.values()
    assert failure.success == pytest.approx(0.3)
    assert one.begin(FIRST)[1] is None
    play(world, one, 1, 2)
    moment = int(again(one)[0])
    one.end(FIRST, YES, simulated=False)
    assert failure.way.success[moment] == pytest.approx(0.5 + 0.3 * 0.5)


def test_an_episode_under_way_outlives_its_way(world, few):
    made = Revisits(1.0, 2, 3, np.random.default_rng(0))
    play(world, made, 1, 3)
    again(made, SECOND)
    play(world, made, 1, 2)
    assert not made.fresh[1]
    made.end(SECOND, NO)
    (failure,) = made._failures.values()
    assert_array_equal(failure.way.success, [0.5, 0.5])  # what came of the old way says nothing about the new one


@pytest.mark.parametrize(("recent", "left"), [(0.0, 1.0), (ENOUGH / 2, 0.5), (ENOUGH, 0.0), (1.0, 0.0)])
@pytest.mark.parametrize("ways", [0, 1, MANY // 2, MANY, 2 * MANY])
def test_the_share_grows_with_ways_and_falls_with_success(world, recent, left, ways):
    made = Revisits(0.5, 1, 2, np.random.default_rng(0))
    for failure in range(ways):
        play(world, made, failure, 2)
    made._fresh_count, made._recent[: round(recent * RECENT)] = RECENT, 1.0
    assert made.share == pytest.approx(0.5 * left * min(1.0, ways / MANY))
    back = sum(len(made.begin(FIRST)[0]) for _ in range(400))
    assert back == pytest.approx(400 * made.share, abs=50)


def between(world, made, failures, lengths, paid=(True, True)):
    """Episodes in both slots at once, decision by decision; the last column tells the slot."""
    made.forget(BOTH)
    for decision in range(max(lengths)):
        for slot in np.flatnonzero(np.array(lengths) > decision):
            made.record(np.array([slot]), moments(world, [decision], failures[slot], slot + 1.0))
    made.end(BOTH, np.array(paid))


def test_slots_do_not_mix_their_ways(world, few):
    made = Revisits(1.0, 2, 4, np.random.default_rng(0))
    between(world, made, (7, 8), (2, 3))
    made._recent[:] = 0.0
    found = set()
    for _ in range(100):
        back, kept = made.begin(BOTH)
        for slot, state, decision in zip(back, kept.state, kept.decisions, strict=True):
            episode = made._episodes[slot]
            assert_array_equal(episode.way.moments.state[episode.moment], state)
            assert state[0] == decision
            found.add(tuple(state.tolist()))
    assert found == {(0, 7, 0), (1, 7, 1), (0, 8, 0), (1, 8, 2), (2, 8, 2)}


def test_each_episode_gets_the_simulation_of_its_own_moment(world, few):
    made = Revisits(1.0, 2, 2, np.random.default_rng(0))
    starts = world.sample(np.random.default_rng(1), 2)
    for decision in range(2):
        at = moments(world, [decision, decision], 0, decision)
        state = at.state + np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
        made.record(BOTH, replace(at, rows=starts, state=state, muted=np.full(2, decision == 0)))
    made.end(BOTH, np.array([True, True]))
    made._recent[:] = 0.0
    for _ in range(50):
        _, kept = made.begin(BOTH)
        whose = kept.state[:, 1].astype(int)
        for name, values in kept.rows.arrays().items():
            assert_array_equal(values, starts.take(whose).arrays()[name])
        assert_array_equal(kept.muted, kept.decisions == 0)


def test_the_share_follows_what_came_of_recorded_failures(world, few):
    made = Revisits(1.0, 1, 3, np.random.default_rng(0))
    outcomes = [True, False, False, False]
    for number, well in enumerate(outcomes):
        made.forget(FIRST)
        for decision in range(2):
            made.record(FIRST, moments(world, [decision], 1))
        made.end(FIRST, np.array([well]), simulated=number == 0)
        recent = np.mean(outcomes[: number + 1])
        assert made.share == pytest.approx(max(0.0, 1.0 - recent / ENOUGH))
    again(made)
    before = made.share
    made.end(FIRST, YES)
    assert made.share == before, "what comes of going back does not count"
    made.forget(FIRST)
    made.record(FIRST, moments(world, [0], 1))
    made.end(FIRST, YES, simulated=False)
    assert made.share == pytest.approx(1.0 - 2 / 5 / ENOUGH), "pay that was not simulated does"
    for _ in range(RECENT):
        play_on(world, made)
    assert made.share == 1.0, "what is long ago does not"


def play_on(world, made):
    """One more failed episode."""
    made.forget(FIRST)
    made.record(FIRST, moments(world, [0], 1))
    made.end(FIRST, NO)


def test_a_way_whose_moments_always_pay_can_be_gone_back_to(world, one):
    play(world, one, 1, 2)
    (failure,) = one._failures.values()
    failure.success, failure.way.success[:] = 1.0, 1.0
    assert again(one)[1] == 1


def test_a_whole_task_is_never_gone_on_with(task: ChainTask):
    learner, rng = make_learner("rc", task, Limits()), np.random.default_rng(0)
    assert learner.pool(task, rng, 2, 0.5)._revisits is not None
    assert replace(learner, whole_task=True).pool(task, rng, 2, 0.5)._revisits is None
