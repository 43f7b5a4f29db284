"""A small world with failures in it."""

import numpy as np
import pytest

from examples.push.world import Push
from p2l.chaining.learner import ChainTask
from p2l.contracts.world import NO_FAILURE
from p2l.skills import chain


@pytest.fixture(scope="package")
def world():
    return Push(nthread=1, sigma_m=0.03)


@pytest.fixture(scope="package")
def nominal(world):
    return world.nominal_options()


@pytest.fixture(scope="package")
def failures(world, nominal):
    """Moments at which the detector fired."""
    done = chain.run(world, nominal, world.sample(np.random.default_rng(0), 60))
    return done.last.take(done.last.kind != NO_FAILURE).rows


@pytest.fixture
def task(world, nominal, failures):
    return ChainTask(world, nominal, failures, seed=0)
