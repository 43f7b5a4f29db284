"""Equation 5.1: nominal where it works, recovery where the detector fires."""

import numpy as np
from numpy.testing import assert_array_equal

from p2l.chaining.agent import agent_of
from p2l.chaining.execute import nominal_part, overall, recover
from p2l.chaining.learners.table import make_learner
from p2l.chaining.mdp import Limits
from p2l.skills.primitives import PRIMITIVES, STEPS
from p2l.skills.runner import Reason

BACK, PUSH = 1, len(PRIMITIVES) + 1


def test_the_recovery_takes_over_where_the_nominal_skills_were_flagged_and_only_there(world, nominal, task):
    starts = world.sample(np.random.default_rng(8), 40)
    plain = nominal_part(world, nominal, starts)
    learner = make_learner("rc", task, Limits())
    agent = agent_of(learner, lambda observation: np.full(len(observation), PUSH))
    found = overall(world, nominal, agent, starts, plain)
    assert_array_equal(found.nominal, plain.success)
    assert_array_equal(found.flagged, plain.last.reason == Reason.FAILURE)
    alone = recover(world, nominal, agent, plain.last.rows.take(found.flagged))
    assert_array_equal(found.success[found.flagged], alone.success)
    assert_array_equal(found.success[~found.flagged], plain.success[~found.flagged])
    assert_array_equal(alone.actions[:, 0], PUSH)
    assert (alone.actions[:, 1:] == -1).all()


def test_an_agent_that_never_hands_over_is_stopped_at_the_bounds(world, nominal, task, failures):
    learner = make_learner("rc", task, Limits(decisions=4))
    found = recover(world, nominal, agent_of(learner, lambda observation: np.full(len(observation), 4)), failures)
    assert not found.success.any()
    unflagged = (found.actions >= 0).sum(axis=1) == 4
    assert unflagged.mean() > 0.9
    assert_array_equal(found.steps[unflagged], 40)
    assert (found.steps[~unflagged] < 40).all()


def test_preconditions_hand_over_to_the_best_controller_at_the_latest_at_the_bounds(world, nominal, task, failures):
    limits = Limits(decisions=2, fields=("grip_pos_m", "block_y_m"))
    learner = make_learner("pp", task, limits, {"trajectories": 60, "every": 2})
    found = recover(world, nominal, agent_of(learner, lambda observation: np.full(len(observation), BACK)), failures)
    assert found.actions.shape[1] == 3
    handed = (found.actions >= len(PRIMITIVES)).any(axis=1)
    early = (found.actions == BACK).sum(axis=1) < 2
    assert handed[early].all(), "whoever stopped moving has handed over"
    late = handed & ~early
    assert late.any()
    assert (found.actions[late, 2] >= len(PRIMITIVES)).all(), "at the bounds somebody takes over"
    moved = np.minimum((found.actions == BACK).sum(axis=1), 2) * STEPS
    assert (handed | (found.steps < moved)).all(), "unless a detector has ended the episode before"
