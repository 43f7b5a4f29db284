"""Laws of learning on the pool: time, cut trajectories, exported policies, resuming."""

from dataclasses import replace

import gymnasium
import numpy as np
import pytest
import torch
from numpy.testing import assert_allclose, assert_array_equal
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback

from p2l.chaining import train as train_module
from p2l.chaining.checkpoint import FILE, load_checkpoint
from p2l.chaining.execute import RecoveryResults
from p2l.chaining.learner import ChainTask
from p2l.chaining.learners.lazy_rc import Lazy, LazySettings
from p2l.chaining.learners.table import make_learner
from p2l.chaining.mdp import Limits
from p2l.chaining.policy import check_policy, load_policy
from p2l.chaining.ppo import PoolPPO, PPOSettings
from p2l.chaining.standardise import RunningStandardise
from p2l.chaining.train import TrainSettings, card_of, split, train
from p2l.chaining.weights import export_policy
from p2l.errors import ArtifactError, ConfigError

SMALL = PPOSettings(n_steps=24, batch_size=12, n_epochs=2, hidden=(8, 8))


def made(task, seed=0, **limits):
    learner = make_learner("rc", task, Limits(**limits))
    pool = learner.pool(task, np.random.default_rng(seed), 8)
    return PoolPPO(pool, SMALL, card_of(task, learner, "rc", "hash").normalisation, seed)


class Keep(BaseCallback):
    """What the buffer holds after each rollout, and the decisions that it was filled with."""

    def __init__(self):
        super().__init__()
        self.rounds = []

    def _on_step(self):
        return True

    def _on_rollout_end(self):
        self.rounds.append((self.locals["decisions"], self.model.rollout_buffer))
        taken, buffer = self.rounds[-1]
        with torch.no_grad():
            after = self.model.policy.predict_values(torch.tensor(taken.after, dtype=torch.float32))[:, 0].numpy()
        assert_allclose(buffer.rewards[:, 0], taken.reward + taken.open_end * 0.99 * after, atol=1e-6)
        assert_array_equal(buffer.episode_starts[:, 0], taken.head)
        # A trajectory of one decision: its advantage is its reward minus its value, by hand.
        alone = taken.head & np.append(taken.head[1:], True)
        assert_allclose(buffer.advantages[alone, 0], (buffer.rewards - buffer.values)[alone, 0], atol=1e-6)


def test_the_buffer_holds_trajectories_and_time_is_simulated_control_steps(task):
    model, keep = made(task), Keep()
    model.learn(600, callback=keep)
    assert model.num_timesteps == model.pool.control_steps >= 600
    assert len(keep.rounds) >= 2
    assert any(taken.open_end.any() for taken, _ in keep.rounds)


def test_a_run_is_decided_by_its_seed(task):
    first, second = made(task, 3).learn(300), made(task, 3).learn(300)
    for one, other in zip(first.policy.parameters(), second.policy.parameters(), strict=True):
        assert torch.equal(one, other)


def test_an_exported_policy_does_what_sb3_does_and_is_refused_elsewhere(task, tmp_path):
    learner = make_learner("rc", task, Limits(history=2))
    card = card_of(task, learner, "rc", "hash")
    train(
        task,
        learner,
        task.failures.take(range(4)),
        TrainSettings(600, 8, 300, 4, SMALL),
        card,
        tmp_path,
        lambda *_: None,
    )
    policy = load_policy(tmp_path)
    model = made(task, history=2)
    observation = np.random.default_rng(0).normal(size=(200, len(card.columns)))
    mine = export_policy(model, card)
    theirs = model.predict(observation.astype(np.float32), deterministic=True)[0]
    logits = mine.logits(observation).detach().numpy()
    best, chosen = logits.max(axis=1), logits[np.arange(len(theirs)), theirs]
    assert (best - chosen <= 1e-3 * np.abs(logits).max()).all()  # but for ties: a policy is kept in half precision
    assert len(np.unique(mine.act(observation))) > 1

    known = {"world": "push", "digest": card.digest, "columns": card.columns, "actions": card.actions}
    check_policy(policy, tmp_path, **known)
    for wrong, message in (
        ({"world": "door"}, "a policy for world 'push'; this is 'door'"),
        ({"actions": card.actions[:-1]}, r"14 actions \(from push\); this world has 13"),
        ({"columns": card.columns[1:]}, r"columns \(grip_pos_m\[0\]\)"),
        ({"digest": "other"}, "other parameters or code"),
    ):
        with pytest.raises(ArtifactError, match=message):
            check_policy(policy, tmp_path, **(known | wrong))
    check_policy(policy, tmp_path, **(known | {"digest": "other"}), transfer=True)


def test_the_policy_of_the_best_evaluation_is_kept_the_later_of_equals(task, tmp_path, monkeypatch):
    learner = make_learner("rc", task, Limits())
    card = card_of(task, learner, "rc", "hash")
    seen, scripted = [], iter([0.25, 0.5, 0.5, *[0.25] * 20])

    def watched(model, card):
        seen.append(export_policy(model, card))
        return seen[-1]

    def judged(*given):
        count, share = len(given[3]), next(scripted)
        return RecoveryResults(
            np.arange(count) < share * count, np.zeros((count, 1), dtype=int), np.ones(count, dtype=int)
        )

    monkeypatch.setattr("p2l.chaining.train.export_policy", watched)
    monkeypatch.setattr("p2l.chaining.selection.recover", judged)
    settings = TrainSettings(1500, 8, 200, 4, SMALL)
    done = train(task, learner, task.failures.take(range(4)), settings, card, tmp_path, _silent)
    assert [row["success"] for row in done.evaluations][:4] == [0.25, 0.5, 0.5, 0.25]
    kept = load_policy(tmp_path)
    assert all(torch.equal(weight, kept.weights[name]) for name, weight in seen[2].weights.items())
    assert not all(torch.equal(weight, kept.weights[name]) for name, weight in seen[1].weights.items())
    assert kept.card.told["evaluation_success"] == done.best == 0.5


def _silent(kind, row):
    """Nobody listens."""


LEARNERS = {"rc": {}, "lazy_rc": {"outcomes": 4, "of_either_kind": 2, "audit": 0.3}, "pp": {"trajectories": 40}}
RUNNING = "rc with a running normalisation"


class KilledError(Exception):
    """As if the process had been killed: nothing tidies up after it."""


def trained(task, name, folder, kill_at=()):
    """Train from nothing or from what is in `folder`; stop after each checkpoint whose number is in `kill_at`."""
    settings = TrainSettings(2400, 8, 300, 4, SMALL, revisit=0.5)
    saved, seen = train_module.save_checkpoint, 0

    def killing(*given):
        nonlocal seen
        saved(*given)
        seen += 1
        if seen in kill_at:
            raise KilledError

    while True:
        running = name == RUNNING  # a new process knows nothing
        plain = "rc" if running else name
        learner = replace(make_learner(plain, task, Limits(), LEARNERS[plain]), running_normalisation=running)
        if name == "lazy_rc":  # so few outcomes would never do
            easy = LazySettings(4, 2, 4, precision=0.4, support=1, audit=0.3)
            shortcut = Lazy(len(learner.primitives), len(task.nominal), easy, task.seed)
            learner = replace(learner, shortcut=shortcut)
        card = card_of(task, learner, name, "hash")
        np.random.seed(99)  # noqa: NPY002 (whatever another process has drawn)
        torch.manual_seed(99)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(train_module, "save_checkpoint", killing)
            try:
                done = train(task, learner, task.failures.take(range(4)), settings, card, folder, _silent)
            except KilledError:
                continue
        return done, (folder / "policy.safetensors").read_bytes()


@pytest.mark.parametrize("name", [*LEARNERS, RUNNING])
def test_a_training_that_was_killed_again_and_again_comes_to_the_same_policy_to_the_bit(name, task, tmp_path):
    """The checkpoint was taken before the rollout's update, and each resume dropped one: 50 % instead of 100 %."""
    whole, policy = trained(task, name, tmp_path / "whole")
    assert len(whole.evaluations) > 5
    assert (whole.spared > 0) == (name == "lazy_rc")
    before, last = (row["control_steps"] + row["spared"] for row in whole.rounds[-2:])
    assert before < 2400 <= last == whole.control_steps + whole.spared, "what is spared is charged to the budget"
    often, again = trained(task, name, tmp_path / "often", kill_at=(1, 2, 3, 5))
    assert again == policy
    for rows in ("rounds", "evaluations"):
        assert getattr(often, rows) == getattr(whole, rows)
    assert set(often.tensors) == set(whole.tensors)
    assert any(name.startswith("pool.revisits.way.") for name in whole.tensors)
    for key, value in whole.tensors.items():
        assert torch.equal(often.tensors[key], value), key


def test_statistics_of_observations_go_on_from_those_of_the_start_by_hand():
    rng = np.random.default_rng(0)
    seen = rng.normal([1.0, -2.0, 0.0], [0.5, 3.0, 1e-3], size=(90, 3))
    start, space = seen[:30], gymnasium.spaces.Box(-1.0, 1.0, (3,))
    running = RunningStandardise(space, start.mean(axis=0), start.std(axis=0), 0.05, 30)
    for part in (seen[30:40], seen[40:]):
        running.include(torch.tensor(part))
    assert_allclose(running.centre, seen.mean(axis=0), rtol=1e-5)
    assert_allclose(running.scale, np.maximum(seen.std(axis=0), 0.05), rtol=1e-5)
    assert float(running.count) == 90


def test_the_card_has_the_normalisation_that_the_weights_were_trained_with(task, tmp_path):
    learner = replace(make_learner("rc", task, Limits()), running_normalisation=True)
    card = card_of(task, learner, "rc", "hash", 0.02)
    model = PoolPPO(learner.pool(task, np.random.default_rng(0), 8), SMALL, card.normalisation, 0, running=True)
    model.learn(600)
    now = model.policy.features_extractor
    assert now.scale.min() == np.float32(0.02)
    observation = task.world.observe(task.failures).values
    mine = export_policy(model, card)
    assert not np.allclose(mine.card.normalisation.centre, card.normalisation.centre)
    theirs = model.predict(observation.astype(np.float32), deterministic=True)[0]
    logits = mine.logits(observation).detach().numpy()
    chosen = logits[np.arange(len(theirs)), theirs]
    assert (logits.max(axis=1) - chosen <= 1e-3 * np.abs(logits).max()).all()
    settings, exported = TrainSettings(900, 8, 300, 4, SMALL), []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            train_module, "export_policy", lambda *given: exported.append(export_policy(*given)) or exported[-1]
        )
        train(task, learner, task.failures.take(range(4)), settings, card, tmp_path, _silent)
    kept = load_policy(tmp_path)
    [same] = [one for one in exported if torch.equal(one.weights["w0"], kept.weights["w0"])]
    assert_array_equal(same.card.normalisation.centre, kept.card.normalisation.centre)
    assert_array_equal(same.logits(observation).numpy(), kept.logits(observation).numpy())


def test_a_killed_run_resumes_and_another_configuration_is_refused(task, tmp_path):
    learner = make_learner("rc", task, Limits())
    card = card_of(task, learner, "rc", "hash")
    apart, settings = task.failures.take(range(4)), TrainSettings(2000, 8, 300, 4, SMALL)

    def killed(kind, row):
        if kind == "evaluation" and row["control_steps"] > 700:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(task, learner, apart, settings, card, tmp_path, killed)
    left = load_checkpoint(tmp_path, card)
    assert 300 <= left.control_steps < 2000
    rows = []
    done = train(task, learner, apart, settings, card, tmp_path, lambda *row: rows.append(row))
    assert [row["round"] for row in done.rounds] == list(range(len(done.rounds)))
    assert done.control_steps >= 2000
    times = [row["control_steps"] for row in done.rounds]
    assert times == sorted(times)
    assert rows[0] == ("resumed", {"control_steps": left.control_steps, "spared": 0})
    assert rows[1][1]["control_steps"] > left.control_steps, "it goes on, it does not start over"
    with pytest.raises(ArtifactError, match=f"{FILE}: left by a run with another configuration"):
        load_checkpoint(tmp_path, card_of(task, learner, "rc", "other"))


def test_bad_input_is_refused_before_anything_is_simulated(task, failures):
    with pytest.raises(ConfigError, match=r"no failures of world 'push'.*stages\.discover"):
        ChainTask(task.world, task.nominal, failures.take(np.zeros(len(failures), dtype=bool)), 0)
    with pytest.raises(
        ConfigError, match="less than one round of 120 decisions of 10 control steps; give at least 1200"
    ):
        TrainSettings(budget=1199).check_rounds()
    with pytest.raises(ConfigError, match="unknown learner 'sac'; known: lazy_rc, pp, rc, rl, search"):
        make_learner("sac", task, Limits())
    for name, params, message in (
        ("lazy_rc", {"audit": 0.0}, "lazy_rc: audit must be a number above 0 and at most 1, got 0.0"),
        ("lazy_rc", {"precision": "high"}, "lazy_rc: precision must be a number above 0 and below 1, got 'high'"),
        ("lazy_rc", {"of_either_kind": 1}, "lazy_rc: of_either_kind must be an integer of at least 2, got 1"),
        ("lazy_rc", {"outcomes": 2.5}, "lazy_rc: outcomes must be an integer of at least 1, got 2.5"),
        ("pp", {"every": 0}, "pp: every must be an integer of at least 1, got 0"),
        ("pp", {"failures": -1}, "pp: failures must be an integer of at least 0, got -1"),
        ("pp", {"precision": 80}, "pp: precision must be a number above 0 and below 1, got 80"),
        ("pp", {"held_out": 0.0}, "pp: held_out must be a number above 0 and below 1, got 0.0"),
        ("pp", {"threshold": 1.0}, "pp: threshold must be a number above 0 and below 1, got 1.0"),
    ):
        with pytest.raises(ConfigError, match=message):
            make_learner(name, task, Limits(), params)
    with pytest.raises(ConfigError, match=r"learner 'pp': unknown parameters \['trees'\]; allowed: trajectories"):
        make_learner("pp", task, Limits(), {"trees": 3})


def test_failures_are_set_apart_only_where_there_are_enough(failures):
    many = failures.take(np.arange(50) % len(failures))
    parts = split(many, 10, 0, "push")
    assert (len(parts.training), len(parts.evaluation)) == (40, 10)
    few = split(many.take(np.arange(12)), 10, 0, "push")
    assert (len(few.training), len(few.evaluation)) == (12, 10)


def test_a_decision_is_sb3s_and_so_is_an_update_to_the_bit(task):
    """SB3's own actor, critic and update are the oracle of ours, generators included."""
    ends = []
    for ours in (True, False):
        model = made(task)
        callback = model._setup_learn(400)[1]
        callback.init_callback(model)
        for _ in range(3):
            assert model.collect_rollouts(model.env, callback, model.rollout_buffer, SMALL.n_steps)
            (PoolPPO if ours else PPO).train(model)
        observation = torch.tensor(model.pool.observation, dtype=torch.float32)
        torch.manual_seed(5)
        plain = model._networks.decide(observation)
        torch.manual_seed(5)
        with torch.no_grad():
            for one, other in zip(plain, model.policy(observation), strict=True):
                assert_array_equal(one.numpy(), other.numpy().reshape(len(observation)))
        ends.append([*(each.detach().numpy() for each in model.policy.parameters()), model.pool.observation])
    for one, other in zip(*ends, strict=True):
        assert_array_equal(one, other)
