"""Macros without a policy: the best one everywhere, any of them, from the same failures as every learner's."""

from dataclasses import dataclass

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from p2l.artifacts import save_json
from p2l.chaining.agent import Agent
from p2l.chaining.ceiling import ANY, CONSTANT, ceiling_of_seed
from p2l.chaining.episodes import PolicyLedger, nominal_episodes
from p2l.chaining.execute import overall
from p2l.chaining.mdp import Limits
from p2l.chaining.policy import Card, Normalisation, Policy
from p2l.chaining.search.macros import MACROS, MacroSpace, load_macros
from p2l.chaining.states import action_names, first_state
from p2l.errors import ArtifactError
from p2l.skills.primitives import PRIMITIVES

EPISODES, SEED = 40, 3


@pytest.fixture
def source(world, nominal, failures):
    """An agent whose network is never asked, with the card of a search."""
    limits = Limits(decisions=4)
    state = first_state(world, failures.take([0]), limits)
    scale = Normalisation(np.zeros(len(state.names)), np.ones(len(state.names)))
    names = action_names(PRIMITIVES, nominal)
    card = Card(world.name, world.digest, "search", SEED, "hash", state.names, names, limits, scale)
    return Agent(limits, PRIMITIVES, lambda states: np.zeros(len(states), dtype=np.int64)), Policy(card, {}, "identity")


@dataclass(frozen=True)
class Fixed(Agent):
    """Carries out one macro, whatever it sees."""

    macro: tuple[int, ...] = ()

    def choose(self, observation, decision):
        """The next action of the macro."""
        return np.array(self.macro)[np.minimum(decision, len(self.macro) - 1)]


def test_rows_are_those_of_robots_that_always_recover_alike(world, nominal, source, tmp_path):
    rng, space = np.random.default_rng(1), MacroSpace(len(PRIMITIVES), len(nominal), 3)
    macros = list(dict.fromkeys(space.random(rng) for _ in range(12)))
    book = PolicyLedger(tmp_path, "", "push", 16)
    rows = ceiling_of_seed(book, world, nominal, SEED, source, macros, EPISODES)
    success = {name: part["success"].to_numpy() for name, part in rows.groupby("learner")}
    starts, plain = nominal_episodes(book, world, nominal, SEED, EPISODES)
    robots = [Fixed(source[0].limits, PRIMITIVES, source[0].act, macro=macro) for macro in macros]
    single = np.array([overall(world, nominal, robot, starts, plain).success for robot in robots])
    assert_array_equal(success[CONSTANT], single[0])
    assert_array_equal(success[ANY], single.any(axis=0))
    assert plain.success.sum() <= success[CONSTANT].sum() < success[ANY].sum()
    again = ceiling_of_seed(book, world, nominal, SEED, source, macros, EPISODES)
    assert again.equals(rows)
    assert len(list(tmp_path.glob("push-search_macros-*.json"))) == 1
    shorter = ceiling_of_seed(book, world, nominal, SEED, source, macros[:1], EPISODES)
    assert len(list(tmp_path.glob("push-search_macros-*.json"))) == 2  # none is taken for another
    assert_array_equal(shorter[shorter["learner"] == ANY]["success"], single[0])


def test_macros_of_other_actions_are_refused(tmp_path):
    save_json(tmp_path / MACROS, {"macros": ["up;from push", "from push"]}, schema="macros", version=1)
    assert load_macros(tmp_path, ("up", "from push"), 1) == [(0, 1)]
    with pytest.raises(ArtifactError, match="a macro of action 'up', which the policy there lacks"):
        load_macros(tmp_path, ("down", "from push"), 9)
