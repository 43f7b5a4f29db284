"""Laws of the RecoveryChaining MDP on real physics: nobody waits, options pay what a fresh run pays, flags absorb."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from examples.push.world import Push
from p2l.chaining.mdp import Limits
from p2l.chaining.pool import Pool
from p2l.contracts.world import NO_FAILURE
from p2l.errors import ConfigError, ShapeError
from p2l.skills import chain
from p2l.skills.follow import Follow, Waypoints
from p2l.skills.primitives import PRIMITIVES, STEPS
from p2l.skills.runner import Reason, Runner

ALIGN, PUSH = len(PRIMITIVES), len(PRIMITIVES) + 1


@pytest.fixture(scope="module")
def world():
    return Push(nthread=1)


@pytest.fixture(scope="module")
def failures(world):
    """Moments at which the detector fired."""
    done = chain.run(world, world.nominal_options(), world.sample(np.random.default_rng(0), 60))
    return done.last.take(done.last.kind != NO_FAILURE).rows


def pool(world, rows, slots, **limits):
    """A pool whose episodes start at `rows` in turn."""
    given = iter(range(10_000))
    return Pool(
        world,
        world.nominal_options(),
        PRIMITIVES,
        lambda n: rows.take([next(given) % len(rows) for _ in range(n)]),
        slots,
        Limits(**limits),
    )


def test_no_slot_waits_for_a_longer_action(world, failures):
    made = pool(world, failures, 2, decisions=50, primitive_steps=1000)
    made.act(np.array([0, 1]), np.array([ALIGN, 4]))
    order = []
    while 0 not in order:
        told = made.poll()
        order += told.slot.tolist()
        if 1 in told.slot:
            made.act(np.array([1]), np.array([5]))
    assert order.count(1) >= 3, "primitives of ten steps must end while the chain of forty is under way"


def chain_from(world, row, first):
    """Whether the chain from option `first` on does the task from one restored failure, a run of its own."""
    runner, chain_of = Runner(world, world.nominal_options(), 1), world.nominal_options()
    runner.place(np.array([0]), row, muted=True)
    for option in range(first, len(chain_of)):
        runner.begin(np.array([0]), np.array([option]))
        while not len((events := runner.advance()).slot):
            pass
        if events.reason[0] in (Reason.FAILURE, Reason.DIVERGENCE):
            return False
    return bool(world.goal(runner.rows)[0])


def test_an_option_pays_what_a_fresh_run_from_the_same_state_pays(world, failures):
    made = pool(world, failures, len(failures))
    slots = np.arange(len(failures))
    shown = []
    for action, first in ((ALIGN, 0), (PUSH, 1)):
        made.act(slots, np.full(len(slots), action))
        paid = np.full(len(slots), np.nan)
        while np.isnan(paid).any():
            told = made.poll()
            assert told.over.all()
            paid[told.slot] = told.reward
        alone = [chain_from(world, failures.take([row]), first) for row in slots]
        assert_array_equal(paid, alone)
        shown += alone
        made = pool(world, failures, len(failures))
    assert set(shown) == {True, False}


def test_time_is_counted_in_control_steps_of_all_slots(world, failures):
    made = pool(world, failures, 3)
    made.act(np.arange(3), np.array([4, 4, 4]))
    told = made.poll()
    assert_array_equal(told.slot, [0, 1, 2])
    assert_array_equal(told.steps, STEPS)
    assert made.control_steps == 3 * STEPS


def test_an_episode_is_cut_at_its_bounds_unpaid_and_says_so(world, failures):
    for limits, expected in (({"decisions": 3}, 3), ({"primitive_steps": 40}, 4)):
        made = pool(world, failures, 1, **limits)
        for decision in range(1, expected + 1):
            made.act(np.array([0]), np.array([4 if decision % 2 else 5]))
            told = made.poll()
            assert told.over[0] == told.cut[0] == (decision == expected)
            assert told.reward[0] == 0.0


def test_a_flag_after_the_first_quiet_step_absorbs(world):
    """The hand passes the block on its side: no flag at first, then `missed`, which ends the episode unpaid."""
    rows = world.sample(np.random.default_rng(1), 1)
    rows.states[:, 2] = 0.05  # the block lies 5 cm beside the hand's way
    rows.sensors[:] = world.engine.sense(rows.states, np.zeros((1, 6)), rows.model)
    made = pool(world, rows, 1)
    decisions, told = 0, None
    while told is None or not told.over[0]:
        made.act(np.array([0]), np.array([0]))
        told = made.poll()
        decisions += 1
    assert 3 <= decisions < 10
    assert not told.cut[0]
    assert told.reward[0] == 0.0
    assert told.steps[0] < STEPS, "an absorbing flag ends the primitive early"


def test_history_is_newest_first_and_starts_over(world, failures):
    made = pool(world, failures, 1, history=3, decisions=2)
    width = len(made.columns) // 3
    start = made.observation[0]
    assert made.columns[width].endswith("@-1") or "@-1" in made.columns[width]
    assert_array_equal(start[:width], start[width : 2 * width])
    made.act(np.array([0]), np.array([4]))
    told = made.poll()
    assert_array_equal(told.observation[0, width : 2 * width], start[:width])
    assert (told.observation[0, :width] != start[:width]).any()
    made.act(np.array([0]), np.array([5]))
    told = made.poll()
    assert told.over[0]
    assert_array_equal(told.next_observation[0, :width], told.next_observation[0, 2 * width :])


def test_an_option_that_never_ends_is_bounded_and_counted(world, failures):
    class Endless(Follow):
        def decide(self, observation, memory, step):
            decision = super().decide(observation, memory, step)
            return type(decision)(decision.command, decision.memory, np.zeros(len(observation), dtype=np.bool_))

    def here(observation):
        return Waypoints(
            observation["target_pos_m"][:, None], observation["target_quat"][:, None], np.zeros((len(observation), 1))
        )

    still = Endless("endless", here, (5,), (0,), lambda truth: np.ones(len(truth), dtype=np.bool_))
    made = Pool(world, (still,), PRIMITIVES, lambda n: failures.take(np.zeros(n, dtype=np.int64)), 1)
    for number in (1, 2):
        made.act(np.array([0]), np.array([ALIGN]))
        told = made.poll()
        assert (told.over[0], told.reward[0]) == (True, 0.0)
        assert (made.timeouts, made.control_steps) == (number, number * still.max_steps)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_reward_that_is_not_finite_is_refused(world, failures, bad):
    def judge(played):
        return np.full(len(played.done), bad), played.done

    made = Pool(world, world.nominal_options(), PRIMITIVES, lambda n: failures.take(np.arange(n)), 1, judge=judge)
    made.act(np.array([0]), np.array([4]))
    with pytest.raises(ShapeError, match="the reward of a decision is NaN or infinite"):
        made.poll()


def test_an_observation_that_is_not_finite_is_refused(world, failures):
    broken = failures.take([0])
    broken.noise[:] = np.nan
    with pytest.raises(ShapeError, match="the observation holds NaN or infinity in block"):
        Pool(world, world.nominal_options(), PRIMITIVES, lambda n: broken.take(np.zeros(n, dtype=np.int64)), 1)


def test_misuse_is_refused(world, failures):
    made = pool(world, failures, 2)
    with pytest.raises(ConfigError, match="every slot waits"):
        made.poll()
    made.act(np.array([0]), np.array([4]))
    with pytest.raises(ConfigError, match=r"slots \[0\] are busy"):
        made.act(np.array([0]), np.array([4]))
    with pytest.raises(ConfigError, match=r"actions must lie in \[0, 14\)"):
        made.act(np.array([1]), np.array([14]))


def test_a_row_is_observed_once_for_a_decision_and_once_where_its_episode_starts(failures):
    class Counted(Push):
        observed = 0

        def observe(self, rows):
            self.observed += len(rows)
            return super().observe(rows)

    world = Counted(nthread=1)
    made = pool(world, failures, 4, decisions=2, history=2)
    assert world.observed == 4
    decisions = starts = 0
    while starts < 6:  # primitives alone, which read nothing on their way
        slots = np.flatnonzero(made.waiting)
        made.act(slots, np.arange(len(slots)) + 4)
        told = made.poll()
        decisions, starts = decisions + len(told.slot), starts + int(told.over.sum())
        assert world.observed == 4 + decisions + starts


def test_a_state_is_the_fields_that_were_asked_for_in_that_order(world, failures):
    fields = ("grip_command", "block_y_m", "target_pos_m")
    every, some = pool(world, failures, 3), pool(world, failures, 3, fields=fields)
    where = [[name.split("[")[0] for name in every.columns].index(field) for field in fields]
    firsts = [[name.split("[")[0] for name in some.columns].index(field) for field in fields]
    assert firsts == sorted(firsts)
    assert_array_equal(some.observation[:, firsts], every.observation[:, where])
