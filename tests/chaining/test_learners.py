"""What each learner adds to the MDP."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from p2l.chaining.learners import rl
from p2l.chaining.learners.lazy_rc import Lazy, LazySettings, certain_from
from p2l.chaining.learners.table import make_learner
from p2l.chaining.mdp import Limits, Transitions
from p2l.chaining.ppo import PoolPPO, PPOSettings
from p2l.chaining.preconditions import ControllerPreconditions, TrajectoryStates, fit, visit
from p2l.chaining.train import card_of
from p2l.contracts.observation import Observation
from p2l.errors import ConfigError
from p2l.skills.primitives import GRIPS, PRIMITIVES


def test_the_threshold_is_the_lowest_with_enough_precision_by_hand():
    probability = np.array([0.9, 0.8, 0.7, 0.6, 0.5, 0.4])
    paid = np.array([True, True, True, False, True, False])
    assert certain_from(probability, paid, precision=0.95, support=2) == 0.7
    assert certain_from(probability, paid, precision=0.79, support=2) == 0.5
    assert certain_from(probability, paid, precision=0.95, support=4) is None
    assert certain_from(probability, ~paid, precision=0.5, support=1) is None
    tied = np.array([0.9, 0.9, 0.9])
    assert certain_from(tied, np.array([True, True, False]), precision=0.95, support=1) is None


def played(slots, done):
    flags = np.ones(len(slots), dtype=bool)
    return Transitions(
        slots,
        np.zeros((len(slots), 1)),
        done.astype(float),
        done,
        flags,
        flags,
        ~flags,
        slots,
        np.zeros((len(slots), 1)),
    )


def outcomes(lazy, rng, count, option=0):
    """Options succeed where the first column is positive."""
    seen, slots = rng.normal(size=(count, 3)), np.arange(count)
    lazy.begin(slots, seen, np.full(count, len(PRIMITIVES) + option))
    lazy.end(played(slots, seen[:, 0] > 0.0))


def test_a_lazy_learner_is_sure_only_after_enough_outcomes_of_either_kind():
    rng = np.random.default_rng(0)
    lazy = Lazy(len(PRIMITIVES), 2, LazySettings(audit=1e-12), seed=0)
    test = np.array([[2.0, 0.0, 0.0], [-2.0, 0.0, 0.0]])
    first, second = (np.full(2, len(PRIMITIVES) + option) for option in (0, 1))
    outcomes(lazy, rng, 45)
    assert not lazy.sure(test, first).any()
    outcomes(lazy, rng, 200)
    assert_array_equal(lazy.sure(test, first), [True, False])
    assert not lazy.sure(test, second).any(), "nothing is known of the other option"
    assert not lazy.sure(test, np.array([0, 3])).any(), "primitives are always simulated"
    again = Lazy(len(PRIMITIVES), 2, LazySettings(audit=1e-12), seed=0)
    again.restore(lazy.state())
    assert_array_equal(again.sure(test, first), [True, False])
    audited = Lazy(len(PRIMITIVES), 2, LazySettings(audit=1.0), seed=0)
    audited.restore(lazy.state())
    assert not audited.sure(test, first).any()


def test_a_lazy_learner_simulates_less_for_as_many_decisions(task):
    settings = PPOSettings(n_steps=60, batch_size=30, n_epochs=1, hidden=(8, 8))
    steps = {}
    for name in ("rc", "lazy_rc"):
        learner = make_learner(name, task, Limits())
        if learner.shortcut is not None:  # it knows all there is to know: coming alongside always works out
            learner.shortcut.sure = lambda observation, action: action == len(PRIMITIVES)
        card = card_of(task, learner, name, "hash")
        model = PoolPPO(
            learner.pool(task, np.random.default_rng(0), 8), settings, card.normalisation, 0, learner.shortcut
        )
        model._setup_learn(1000)
        from stable_baselines3.common.callbacks import CallbackList

        callback = CallbackList([])
        callback.init_callback(model)
        assert model.collect_rollouts(model.env, callback, model.rollout_buffer, 60)
        steps[name] = model.num_timesteps
        settled = model.round.settled
        aligned = model.rollout_buffer.actions[:, 0] == len(PRIMITIVES)
        if learner.shortcut is not None:
            assert settled >= aligned.sum() > 0
            assert (model.rollout_buffer.rewards[aligned] == 1.0).all()
    assert steps["lazy_rc"] < steps["rc"]


def test_pretrained_preconditions_pay_where_one_holds_and_name_the_best_controller(world, nominal, task):
    learner = make_learner("pp", task, Limits(fields=("grip_pos_m", "block_y_m")), {"trajectories": 60, "every": 2})
    known = learner.preconditions
    copied = ControllerPreconditions.from_arrays(known.arrays())
    visited = visit(world, nominal, world.sample(np.random.default_rng(5), 40), every=4)
    state = np.concatenate([visited.observation["grip_pos_m"], visited.observation["block_y_m"]], axis=1)
    assert_allclose(copied.score(state), known.score(state))
    for option in (0, 1):
        mine = visited.option == option
        scores = known.score(state)[mine, option]
        assert scores[visited.success[mine]].mean() > scores[~visited.success[mine]].mean()
    assert_array_equal(known.holds(state), known.score(state)[np.arange(len(state)), known.best(state)] >= 0.5)
    far = state + [0.0, 0.0, 0.3, 0.0]
    assert not known.holds(far).any(), "far from all data nothing is believed to hold"
    pool = learner.pool(task, np.random.default_rng(0), 4)
    assert pool.actions == tuple(option.name for option in PRIMITIVES)


def test_the_number_of_actions_so_far_says_nothing_about_a_precondition(world, nominal):
    """In nominal runs it tells the controllers apart; a recovery has taken more."""
    visited = visit(world, nominal, world.sample(np.random.default_rng(5), 60), every=2)
    fields = {"actions": visited.option[:, None], "block_y_m": visited.observation["block_y_m"]}
    counted = TrajectoryStates(Observation.of(fields), visited.option, visited.success)
    known = fit(counted, nominal, ("actions", "block_y_m"), 0.5, np.random.default_rng(0))
    state = np.stack([np.zeros(20), np.linspace(-0.1, 0.1, 20)], axis=1)
    assert_array_equal(known.score(state), known.score(state + [7.0, 0.0]))
    assert np.ptp(known.score(state)) > 0.1


def test_states_of_nominal_runs_are_labelled_by_how_the_run_ended(world, nominal):
    visited = visit(world, nominal, world.sample(np.random.default_rng(2), 12), every=3)
    assert set(visited.option.tolist()) == {0, 1}
    assert 0 < visited.success.sum() < len(visited.success)
    late = visited.observation["grip_pos_m"][visited.option == 1]
    assert late[:, 0].mean() > visited.observation["grip_pos_m"][visited.option == 0][:, 0].mean()


def test_flat_learning_is_paid_for_progress_and_may_use_its_fingers(task, world, monkeypatch):
    with pytest.raises(ConfigError, match="no dense reward for world 'push'; say where its object belongs by"):
        make_learner("rl", task, Limits())
    monkeypatch.setattr(world, "delivery_pos", lambda truth: np.zeros((len(truth), 3)), raising=False)
    monkeypatch.setattr(world, "_truth", _with_object(world))
    learner = make_learner("rl", task, Limits(), {"decisions": 3, "starts": 5})
    assert learner.whole_task
    assert len(learner.starts) == 5
    assert learner.primitives == (*PRIMITIVES, *GRIPS)
    pool = learner.pool(task, np.random.default_rng(0), 1)
    before = rl.potential(world, pool._runner.rows.take([0]), world.delivery_pos)
    pool.act(np.array([0]), np.array([0]))
    told = pool.poll()
    after = rl.potential(world, pool._runner.rows.take([0]), world.delivery_pos)
    assert_allclose(told.reward, after - before)
    assert told.reward[0] > 0.0, "2 cm closer to the block"


def _with_object(world):
    plain = world._truth
    return lambda rows: {**plain(rows), "object_pos_m": plain(rows)["block_pos_m"], "gap_m": np.full(len(rows), 0.05)}
