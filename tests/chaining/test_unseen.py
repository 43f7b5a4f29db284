"""What a recovery policy could not see does not change what it does."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import torch
from hydra import compose, initialize_config_dir
from numpy.testing import assert_allclose, assert_array_equal

from p2l import make_world
from p2l.chaining.learner import ChainTask
from p2l.chaining.learners.table import make_learner
from p2l.chaining.mdp import Limits
from p2l.chaining.policy import Policy
from p2l.chaining.states import first_state
from p2l.chaining.train import card_of
from p2l.contracts.world import NO_FAILURE
from p2l.skills import chain

CONF = Path(__file__).parents[2] / "conf"


def failures_of(world, episodes):
    done = chain.run(world, world.nominal_options(), world.sample(np.random.default_rng(0), episodes))
    return done.last.take(done.last.kind != NO_FAILURE).rows


def with_truth_elsewhere(world, rows):
    """The thing is elsewhere, seen at the same place: the error of the estimate makes up for it. And other masses."""
    noise = -0.5 * rows.noise
    shift = world.estimator.error(rows.noise, rows.actions) - world.estimator.error(noise, rows.actions)
    shift = np.pad(shift[:, :2], ((0, 0), (1, 0)))  # the error is in y and z
    states, sensors = rows.states.copy(), rows.sensors.copy()
    place = 1 + int(world.scenes[0].model.joint(world.bank.object_joint).qposadr[0])
    states[:, place : place + 3] += shift
    sensors[:, world.engine.sensor_columns["object_pos"]] += shift
    model = (rows.model + 1) % len(world.scenes)
    return replace(rows, states=states, sensors=sensors, noise=noise, model=model), shift


@pytest.fixture(scope="module", params=["cluttered_shelf", "shelf"])
def met(request):
    """A world, and failures of its nominal skills."""
    world = make_world(request.param, {"nthread": 1})
    rows = failures_of(world, 60)
    assert len(rows) > 10
    return world, rows


@pytest.mark.parametrize("learner", ["rc", "search"])
def test_an_action_does_not_depend_on_where_the_thing_really_is(met, learner):
    """With the columns that each learner sees, and a network that is sensitive to every one of them."""
    world, rows = met
    with initialize_config_dir(str(CONF), version_base=None):
        cfg = compose("chain_recoveries", [f"world={world.name}"])
    own = dict(cfg.limits) | dict(cfg.limits_of.get(learner, {}))
    limits = Limits(**own | {"fields": tuple(own["fields"])})
    task = ChainTask(world, world.nominal_options(), rows, seed=0)
    card = card_of(task, make_learner(learner, task, limits), learner, "hash", cfg.narrowest)
    rng, sizes = np.random.default_rng(0), (len(card.columns), 64, len(card.actions))
    weights = {f"w{k}": torch.tensor(rng.normal(size=(out, into))) for k, (into, out) in enumerate(pairwise(sizes))}
    policy = Policy(card, {**weights, **{f"b{k}": torch.zeros(out) for k, out in enumerate(sizes[1:])}})
    other, shift = with_truth_elsewhere(world, rows)
    assert np.abs(shift).max(axis=1).mean() > 0.005
    truth, moved = (world.privileged(each)["object_pos_m"] for each in (rows, other))
    assert_allclose(moved - truth, shift, atol=1e-12)
    seen, again = (first_state(world, each, limits).values for each in (rows, other))
    assert_allclose(again, seen, atol=1e-9)
    assert_array_equal(policy.act(again), policy.act(seen))
    mistaken = first_state(world, replace(rows, noise=other.noise), limits).values
    assert (policy.act(mistaken) != policy.act(seen)).any()  # what is seen does count
