"""Trained recoveries on the small push world: what a skill does at a failure that REPS solved, and modes too small."""

from dataclasses import replace

import numpy as np
import pytest

from p2l.artifacts import load_arrays, save_arrays
from p2l.errors import ArtifactError
from p2l.metareskill.ledger import Entry, Ledger
from p2l.metareskill.members import Members
from p2l.metareskill.query import QueryOptions, query
from p2l.metareskill.regression import ParameterisedSkill
from p2l.metareskill.start import Start
from p2l.metareskill.trainer import Trainer
from p2l.skills import chain
from p2l.skills.execute import without_noise
from p2l.skills.relative import SIZE
from tests.metareskill import pushing_back as pb

PUSH = 1
OPTIONS = QueryOptions(updates=2, rollouts=8, solved=0.3, timing=pb.TIMING, verify=False)


def entry(failure, parameters, q):
    return Entry(failure, True, parameters, np.array([1.0]), np.array([0.5]), 8, q, 1, 0.0)


@pytest.fixture(scope="module")
def task():
    return pb.setting(estimator="exact")[1]


def start(modes, guess, q=0.0):
    return Start(((guess,) * 3,) * modes, np.full((modes, 3), q))


def trainer(task, failures, held_out, guess="straight", q=0.0):
    rows = pb.standing(task.world, np.linspace(0.10, 0.16, len(failures)), 0.08)
    tests = pb.standing(task.world, 0.13, np.full(len(held_out), 0.08))
    given = Members(rows, np.array(failures)), Members(tests, np.array(held_out))
    return Trainer(task, *given, OPTIONS, 0, Ledger(""), start(max(failures) + 1, guess, q))


@pytest.mark.parametrize("guess", ["straight", "take", "carry", ""])
def test_at_a_solved_failure_a_skill_does_what_reps_found_there_also_after_storage(task, guess, tmp_path):
    made, found = trainer(task, [0, 0, 0], [0], guess), np.random.default_rng(1).normal(size=(2, SIZE))
    made.ledger.entries.update({(0, PUSH, n): entry(n, found[n], q=0.1 * n) for n in range(2)})
    skill = made.skill(0, PUSH, trainings=2)
    save_arrays(tmp_path / "skill.npz", skill.arrays(), schema="recovery", version=1)
    back = ParameterisedSkill.from_arrays(load_arrays(tmp_path / "skill.npz", schema="recovery", version=1))
    seen = task.world.observe(without_noise(made.failures.rows))
    for each in (skill, back):
        assert each.guess == guess
        np.testing.assert_allclose(task.recovery(each, PUSH, seen)[:2], found, atol=1e-12)
    added = task.recovery(skill, PUSH, seen)[2] - skill.predict(task.symbols.state(seen)[2:, [0, 1]])[0]
    np.testing.assert_allclose(added, task.guessed(guess, seen, PUSH)[2] if guess else 0.0, atol=1e-12)


def test_a_mode_of_one_failure_is_trained_from_it_again_and_again(task):
    made = trainer(task, [0, 1, 0], [0, 1])
    told = [made(1, PUSH, before) for before in range(3)]
    assert [each.failure for each in made.ledger.of(1, PUSH, 3)] == [1, 1, 1]
    assert all(0.0 <= each.q <= 1.0 and each.trials == 1 for each in told)
    assert any(each.solved for each in told)
    assert np.isfinite(task.recovery(made.skill(1, PUSH, 3), PUSH, task.world.observe(made.held_out.rows))).all()


def test_the_guess_is_a_skill_until_a_trained_one_is_better(task):
    made = trainer(task, [0, 0, 0], [0], "straight", q=0.5)
    seen = task.world.observe(without_noise(made.failures.rows))
    assert made.kept(0, PUSH, 0) == 0
    np.testing.assert_allclose(task.recovery(made.skill(0, PUSH, 0), PUSH, seen), task.straight(seen, PUSH))
    found = np.random.default_rng(1).normal(size=(2, SIZE))
    made.ledger.entries.update({(0, PUSH, n): entry(n, found[n], q=0.4 + 0.2 * n) for n in range(2)})
    assert [made.kept(0, PUSH, trainings) for trainings in range(3)] == [0, 0, 2]
    assert len(made.skill(0, PUSH, 2).states) == 2
    assert trainer(task, [0], [0], "straight").kept(0, PUSH, 0) is None, "one that never works is none"


def test_the_first_mean_of_a_query_is_the_guess(task):
    """With no spread to speak of the search stays where it begins."""
    still = replace(OPTIONS, updates=1, sigma_m=(1e-9,) * 3, sigma_rad=1e-9, sigma_grip=1e-9)
    row = pb.standing(task.world, 0.13, 0.08)
    seen = task.world.observe(row)
    [answer] = query(task, row, [PUSH], [np.random.default_rng(0)], still, ["take"])
    np.testing.assert_allclose(answer.parameters, task.guessed("take", seen, PUSH)[0], atol=1e-7)


def test_all_updates_are_made_as_the_authors_did_also_of_what_is_solved_or_hopeless(task):
    row, rng = pb.standing(task.world, 0.13, 0.08), lambda: [np.random.default_rng(3)]
    easy = QueryOptions(updates=4, rollouts=8, solved=0.1, hopeless=1, timing=pb.TIMING, verify=False)
    [short] = query(task, row, [PUSH], rng(), easy)
    [whole] = query(task, row, [PUSH], rng(), replace(easy, all_updates=True))
    assert short.solved
    assert len(short.success) < 4
    assert len(whole.success) == len(whole.kl_nats) == 4
    assert whole.rollouts == 32
    assert whole.success[: len(short.success)] == short.success, "the same search, carried on"
    assert whole.kl_nats[: len(short.kl_nats)] == short.kl_nats
    impossible = replace(easy, solved=1.0, all_updates=True)
    far = pb.standing(task.world, 0.13, 0.6)
    [lost] = query(task, far, [PUSH], rng(), impossible)
    assert len(lost.success) == 4
    assert not lost.solved


def test_a_precondition_that_is_tried_holds_only_where_the_skills_reach_the_goal(task):
    """Beside the block by 0 to 4 cm: push is believed to work within 16 mm, and is then really pushed."""
    rows = pb.standing(task.world, -0.08, np.linspace(0.0, 0.04, 9))
    believed_reward, believed = task.judge(rows, PUSH)
    reward, holds = task.judge(rows, PUSH, verify=True)
    pushed = chain.run(task.world, task.world.nominal_options()[PUSH:], rows, stop_on_failure=False).success
    np.testing.assert_array_equal(holds, believed & pushed)
    assert believed.any()
    assert not believed.all()
    np.testing.assert_array_equal(task.leads_to_goal(rows, PUSH), pushed)
    probability = task.preconditions.probability(task.state(rows), task.world.goal(rows))[:, PUSH]
    np.testing.assert_allclose(believed_reward - reward, np.where(holds, 0.0, 10.0 * probability), atol=1e-9)
    assert not task.leads_to_goal(pb.standing(task.world, 0.13, 0.08), 2).any(), "the goal itself leads nowhere else"


def test_a_mode_without_held_out_failures_cannot_be_measured(task):
    with pytest.raises(ArtifactError, match="mode 1 has no held-out failure"):
        trainer(task, [0, 1], [0]).tests(1)
