"""What each learner adds to the MDP."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from p2l.chaining.certainty import certain_from
from p2l.chaining.learners import rl
from p2l.chaining.learners.lazy_rc import Lazy, LazySettings
from p2l.chaining.learners.table import make_learner
from p2l.chaining.mdp import Limits, Transitions
from p2l.chaining.pool import Pool
from p2l.chaining.ppo import PoolPPO, PPOSettings
from p2l.chaining.preconditions import (
    SUPPORT,
    ControllerPreconditions,
    TrajectoryStates,
    at_failures,
    fit,
    fit_offline,
    restart,
    visit,
)
from p2l.chaining.train import card_of
from p2l.contracts.observation import Observation
from p2l.errors import ConfigError
from p2l.skills import chain
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


def test_an_option_that_is_not_simulated_counts_like_those_that_were_by_hand():
    """Two successes of the first option took 10 and 13 control steps, a failure 40."""
    lazy = Lazy(len(PRIMITIVES), 2, LazySettings(), seed=0)
    slots = np.array([10, 13, 40])  # `played` takes them as control steps, too
    lazy.begin(slots, np.eye(3), np.full(3, len(PRIMITIVES)))
    lazy.end(played(slots, np.array([True, True, False])))
    lazy.spare(np.full(2, len(PRIMITIVES)))
    assert lazy.spared == 24  # 11.5 is rounded to even
    again = Lazy(len(PRIMITIVES), 2, LazySettings(), seed=0)
    again.restore(lazy.state())
    again.spare(np.array([len(PRIMITIVES)]))
    assert again.spared == 36


def test_a_lazy_learner_simulates_less_for_as_many_decisions(task):
    settings = PPOSettings(n_steps=60, batch_size=30, n_epochs=1, hidden=(8, 8))
    steps = {}
    for name in ("rc", "lazy_rc"):
        learner = make_learner(name, task, Limits())
        if learner.shortcut is not None:  # it knows all there is to know: coming alongside always works out
            learner.shortcut.sure = lambda observation, action: action == len(PRIMITIVES)
            learner.shortcut._lengths[0] = (150, 10)
        card = card_of(task, learner, name, "hash")
        model = PoolPPO(
            learner.pool(task, np.random.default_rng(0), 8), settings, card.normalisation, 0, learner.shortcut
        )
        model._setup_learn(1000)
        from stable_baselines3.common.callbacks import CallbackList

        callback = CallbackList([])
        callback.init_callback(model)
        assert model.collect_rollouts(model.env, callback, model.rollout_buffer, 60)
        steps[name] = model.pool.control_steps
        settled = model.round.settled
        aligned = model.rollout_buffer.actions[:, 0] == len(PRIMITIVES)
        if learner.shortcut is not None:
            assert settled >= aligned.sum() > 0
            assert (model.rollout_buffer.rewards[aligned] == 1.0).all()
            assert learner.shortcut.spared == 15 * settled
            assert model.num_timesteps == model.pool.control_steps + 15 * settled
    assert steps["lazy_rc"] < steps["rc"]


def labelled(world, nominal, starts):
    return TrajectoryStates(world.observe(starts.rows), starts.option, restart(world, nominal, starts)[0])


def test_pretrained_preconditions_pay_where_one_holds_and_name_the_best_controller(world, nominal, task):
    learner = make_learner(
        "pp", task, Limits(fields=("grip_pos_m", "block_y_m")), {"trajectories": 60, "every": 2, "failures": 0}
    )
    known = learner.preconditions
    copied = ControllerPreconditions.from_arrays(known.arrays())
    states = labelled(world, nominal, visit(world, nominal, world.sample(np.random.default_rng(5), 40), every=4)[0])
    state = np.concatenate([states.observation["grip_pos_m"], states.observation["block_y_m"]], axis=1)
    assert_allclose(copied.score(state), known.score(state))
    for option in (0, 1):
        mine = states.option == option
        scores = known.score(state)[mine, option]
        assert scores[states.success[mine]].mean() > scores[~states.success[mine]].mean()
    best = known.score(state)[np.arange(len(state)), known.best(state)]
    assert_array_equal(known.holds(state), best >= known.threshold)
    far = state + [0.0, 0.0, 0.3, 0.0]
    assert not known.holds(far).any(), "far from all data nothing is believed to hold"
    pool = learner.pool(task, np.random.default_rng(0), 4)
    assert pool.actions == tuple(option.name for option in PRIMITIVES)


def test_the_number_of_actions_so_far_says_nothing_about_a_precondition(world, nominal):
    """In nominal runs it tells the controllers apart; a recovery has taken more."""
    states = labelled(world, nominal, visit(world, nominal, world.sample(np.random.default_rng(5), 60), every=2)[0])
    fields = {"actions": states.option[:, None], "block_y_m": states.observation["block_y_m"]}
    counted = TrajectoryStates(Observation.of(fields), states.option, states.success)
    known = fit(counted, nominal, ("actions", "block_y_m"), 0.5, np.random.default_rng(0))
    state = np.stack([np.zeros(20), np.linspace(-0.1, 0.1, 20)], axis=1)
    assert_array_equal(known.score(state), known.score(state + [7.0, 0.0]))
    assert np.ptp(known.score(state)) > 0.1


def test_states_of_nominal_runs_are_visited_with_the_controller_that_runs(world, nominal):
    starts = world.sample(np.random.default_rng(2), 12)
    visited, steps = visit(world, nominal, starts, every=3)
    assert set(visited.option.tolist()) == {0, 1}
    assert steps == chain.run(world, nominal, starts).last.step.sum()
    seen = world.observe(visited.rows)["grip_pos_m"][:, 0]
    assert seen[visited.option == 1].mean() > seen[visited.option == 0].mean()
    assert np.bincount(visited.source, minlength=12).min() >= 2


def test_a_state_is_labelled_by_starting_its_controller_there(world, nominal, failures):
    """One after the other, in the pool of the MDP; labels of the whole run are wrong for some of the states."""
    starts = world.sample(np.random.default_rng(2), 12)
    visited = visit(world, nominal, starts, every=2)[0]
    everything = visited.join(at_failures(failures.take(np.arange(3)), len(nominal), 12))
    success, steps = restart(world, nominal, everything)
    taken = 0
    for k in range(len(everything)):
        if everything.muted[k]:
            row = everything.rows.take([k])
            pool = Pool(world, nominal, (), lambda n, row=row: row.take(np.zeros(n, dtype=int)), 1, Limits())
            pool.act(np.array([0]), everything.option[[k]])
            assert pool.poll().done[0] == success[k]
            taken += pool.control_steps
        else:
            alone = chain.run(world, nominal[everything.option[k] :], everything.rows.take([k]))
            assert alone.success[0] == success[k]
            taken += int(alone.last.step.sum())
    assert steps == taken
    of_run = chain.run(world, nominal, starts).success[visited.source]
    assert (of_run != success[: len(visited)]).any()


def test_the_threshold_is_calibrated_on_runs_that_were_held_out(world, nominal, failures):
    """With the controller that scores best, as a recovery hands over."""
    starts = visit(world, nominal, world.sample(np.random.default_rng(5), 120), every=2)[0]
    starts = starts.join(at_failures(failures, len(nominal), 120))
    given = (world, nominal, starts, ("grip_pos_m",), 0.01)
    loose = fit_offline(*given, None, 0.4, np.random.default_rng(0))
    assert loose.preconditions.threshold == 0.01
    wanted = loose.held_out_precision + 0.02
    strict = fit_offline(*given, wanted, 0.4, np.random.default_rng(0))
    assert strict.preconditions.threshold > 0.01
    assert strict.held_out_precision > wanted
    assert SUPPORT <= strict.held_out_support < loose.held_out_support
    assert strict.steps == loose.steps > restart(world, nominal, starts)[1], "handovers are simulated, too"
    enough = fit_offline(*given, loose.held_out_precision - 0.02, 0.4, np.random.default_rng(0))
    assert enough.preconditions.threshold == 0.01, "it is precise as it is"
    never = fit_offline(*given, 0.9999, 0.4, np.random.default_rng(0))
    assert never.preconditions.threshold in (0.01, strict.preconditions.threshold) or never.held_out_precision == 1.0


def test_what_preconditions_cost_is_told(task):
    learner = make_learner("pp", task, Limits(), {"trajectories": 40, "failures": 2})
    more = make_learner("pp", task, Limits(), {"trajectories": 40, "failures": 4})
    assert 0 < learner.told["offline_steps"] < more.told["offline_steps"]
    assert learner.told["threshold"] == learner.preconditions.threshold
    assert learner.told["held_out_support"] > 0


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
