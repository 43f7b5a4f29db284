"""The MDP passes the checkers of gymnasium and stable-baselines3, and agrees with the pool that it wraps."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env as gymnasium_check
from numpy.testing import assert_array_equal
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env as sb3_check

from p2l.chaining.env import RecoveryEnv, RecoveryVecEnv, RecoveryVectorEnv
from p2l.chaining.pool import Pool
from p2l.errors import ConfigError
from p2l.skills.primitives import PRIMITIVES

ALIGN, PUSH = len(PRIMITIVES), len(PRIMITIVES) + 1


@pytest.fixture
def make(world, nominal):
    return lambda starts, slots: Pool(world, nominal, PRIMITIVES, starts, slots)


def test_the_checkers_have_nothing_to_say(make, failures):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*(spec|render|infinity).*")  # neither registered nor drawn
        gymnasium_check(RecoveryEnv(make, failures), skip_render_check=True)
        sb3_check(RecoveryEnv(make, failures))


def test_rows_of_the_vector_environment_are_episodes_of_the_single_one(make, failures):
    many = RecoveryVectorEnv(make, failures, 3)
    assert isinstance(many, gymnasium.vector.VectorEnv)
    seen, _ = many.reset(seed=4)
    again, _ = many.reset(seed=4)
    assert_array_equal(seen, again)
    assert many.observation_space.contains(seen)
    _, _, ended, cut, info = many.step(np.array([4, PUSH, 5]))
    assert_array_equal(ended, [False, True, False])
    assert not cut.any()
    assert_array_equal(info["_final_obs"], ended)
    assert many.single_observation_space.contains(info["final_obs"][1])
    assert info["control_steps"][1] > info["control_steps"][0]

    one = RecoveryEnv(make, failures)
    one._pool._starts = lambda n: failures.take([1])  # row 1 drew some failure; start both at the same
    many._pool._starts = lambda n: failures.take([1] * n)
    alone, _ = one.reset(seed=0)
    seen, _ = many.reset(seed=0)
    assert_array_equal(seen, [alone] * 3)
    for action in (4, PUSH):
        alone, paid, over, late, _ = one.step(action)
        after, reward, ended, cut, info = many.step(np.full(3, action))
        assert_array_equal(reward, paid)
        assert_array_equal(ended, over)
        assert_array_equal(cut, late)
        assert_array_equal(info["final_obs"][0] if over else after[0], alone)


def test_rows_that_are_sent_to_do_not_wait_for_a_longer_action(make, failures):
    env = RecoveryVectorEnv(make, failures, 2)
    env.reset(seed=0)
    for actions, rows in (([4], [0, 1]), ([4, 5], [0, 0]), ([4], [2]), ([4], [-1]), ([4, 4], [True, False])):
        with pytest.raises(ConfigError, match=r"slots must be different integers in \[0, 2\)"):
            env.send(np.array(actions), np.array(rows))
    env.send(np.array([ALIGN, 4]), np.arange(2))
    order, steps = [], []
    while 0 not in order:
        seen, _, ended, cut, info = env.recv()
        assert len(seen) == len(ended) == len(cut) == len(info["env_id"])
        order += info["env_id"].tolist()
        steps += info["control_steps"].tolist()
        if 1 in info["env_id"]:
            with pytest.raises(ConfigError, match=r"slots \[0\] are busy"):
                env.send(np.array([4]), np.array([0]))
            env.send(np.array([5]), np.array([1]))
    assert order.count(1) >= 3, "primitives of ten steps must end while the chain of forty is under way"
    assert steps[order.index(0)] > 3 * min(steps)
    assert info["final_obs"][order[-len(seen) :].index(0)] is not None, "an option ends its episode"


def test_other_learners_of_stable_baselines3_can_use_it(make, failures):
    rows = iter(range(10_000))
    pool = make(lambda n: failures.take([next(rows) % len(failures) for _ in range(n)]), 4)
    model = PPO("MlpPolicy", RecoveryVecEnv(pool), n_steps=4, batch_size=8, n_epochs=1, seed=0, device="cpu")
    model.learn(16)
    assert model.num_timesteps == 16
    assert pool.control_steps > 16
