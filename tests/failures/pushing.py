"""Failures of the small push world, found for real."""

from p2l.failures.discovery import find_failures
from p2l.failures.record import STRANDED, Origin
from p2l.failures.strategy import ESTIMATORS
from p2l.seeding import generator
from p2l.worlds.table import WORLDS, make_world

WORLDS.register("push", "examples.push.world:Push")


def setting(strategy, split="train", episodes=40, world="push", **params):
    """World, options, starts and origin of a discovery."""
    params |= {"nthread": 1} | ({"estimator": ESTIMATORS[strategy]} if ESTIMATORS[strategy] else {})
    made = make_world(world, params)
    options = made.nominal_options()
    starts = made.sample(generator(0, "discover", world, split), episodes)
    names, kinds = tuple(option.name for option in options), (*made.failure_kinds, STRANDED)
    return made, options, starts, Origin(world, params, made.digest, strategy, split, 0, episodes, 10, names, kinds)


def found(strategy="pessimistic", **settings):
    """World, options and what discovery found."""
    world, options, starts, origin = setting(strategy, **settings)
    return world, options, find_failures(world, options, starts, origin, slots=16)
