"""The learner that searches: macros, their outcomes, what is tried next, and the policy that comes of it."""

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from p2l.chaining.agent import Agent, load_agent
from p2l.chaining.execute import recover
from p2l.chaining.learners.table import make_learner
from p2l.chaining.mdp import Limits
from p2l.chaining.ppo import PPOSettings
from p2l.chaining.search import train as search_module
from p2l.chaining.search.macros import MacroSpace, load_macros, macro_of, padded
from p2l.chaining.search.model import OutcomeTable, SuccessModel, pair_features
from p2l.chaining.search.network import clone
from p2l.chaining.search.proposals import DEPTH, FEWEST, RoundPlan, promising, propose
from p2l.chaining.search.train import SearchMemory, search_train
from p2l.chaining.search.trials import run_trials
from p2l.chaining.states import action_names, first_state
from p2l.chaining.train import TrainSettings, card_of
from p2l.errors import ConfigError
from p2l.skills.primitives import PRIMITIVES

SPACE = MacroSpace(primitives=4, options=2, longest=3)


@given(st.integers(0, 2**32 - 1))
def test_every_macro_ends_with_its_only_option_and_is_no_longer_than_asked(seed):
    rng = np.random.default_rng(seed)
    macro = SPACE.random(rng)
    for _ in range(20):
        *body, option = macro
        assert len(body) <= SPACE.longest
        assert all(0 <= action < SPACE.primitives for action in body)
        assert SPACE.primitives <= option < SPACE.primitives + SPACE.options
        assert macro_of(padded([macro], 6)[0]) == macro
        macro = SPACE.neighbour(macro, rng)


def test_a_macro_in_numbers_by_hand():
    two, one = SPACE.encoding([(1, 1, 3, 5), (4,)])
    assert_array_equal(two, [0, 2, 0, 1, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 4])
    assert_array_equal(one, [0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 1])


def test_differences_are_of_positions_of_the_same_moment():
    columns = ("a_pos_m[0]", "a_pos_m[1]", "b_pos_m[0]", "b_pos_m[1]", "finger_pos_m", "a_pos_m@-1[0]", "a_pos_m@-1[1]")
    states = np.array([[1.0, 2.0, 5.0, 7.0, 9.0, 3.0, 4.0]])
    assert_allclose(pair_features(states, columns), [[1.0, 2.0, 5.0, 7.0, 9.0, 3.0, 4.0, -4.0, -5.0]])


def test_what_is_known_of_macros_by_hand():
    table = OutcomeTable()
    for failure, macro, well in ((0, (4,), True), (1, (4,), False), (2, (4,), True), (1, (0, 5), False)):
        table.add(failure, macro, well)
    assert table.tried(1, (4,))
    assert not table.tried(0, (0, 5))
    assert_array_equal(table.solved(4), [True, False, True, False])
    assert table.winners(9) == [(4,)]
    assert table.rate((4,)) == pytest.approx(2.3 / 5)
    assert table.rate((1, 4)) == pytest.approx(0.15)


def told(rng, count):
    """Two macros, of which the first helps where the only column is positive, the second where it is not."""
    table, features = OutcomeTable(), rng.normal(size=(count, 1))
    for failure in range(count):
        macro = (4,) if failure % 2 else (5,)
        table.add(failure, macro, bool((features[failure, 0] > 0.0) == (macro == (4,))))
    return table, features


def test_the_model_learns_which_macro_helps_where():
    table, features = told(np.random.default_rng(0), 200)
    model = SuccessModel.fit(features, table, SPACE, 0)
    chance = model.probability(np.array([[1.0], [-1.0]]), [(4,), (5,)])
    assert chance.shape == (2, 2)
    assert_array_equal(chance.argmax(axis=1), [0, 1])
    assert (chance.max(axis=1) > 0.8).all()
    few = model.probability(np.array([[1.0]]), [(4,), (5,)], np.array([0, 1]))
    assert few.shape == (1, 2)
    assert SuccessModel.fit(features[:1], OutcomeTable(), SPACE, 0) is None


@given(st.integers(0, 2**32 - 1), st.integers(1, 60))
def test_nothing_is_tried_twice(seed, trials):
    rng = np.random.default_rng(seed)
    table, features = told(np.random.default_rng(1), 30)
    model = SuccessModel.fit(features, table, SPACE, 0)
    for _ in range(4):
        proposed = propose(RoundPlan(trials, 10), SPACE, table, model, features, rng)
        assert len(set(proposed)) == len(proposed) <= trials
        assert not any(table.tried(*trial) for trial in proposed)
        for failure, macro in proposed:
            table.add(failure, macro, False)


def test_macros_are_looked_for_at_a_few_failures_first():
    rng, features = np.random.default_rng(0), np.zeros((500, 1))
    first = propose(RoundPlan(200, 10), SPACE, OutcomeTable(), None, features, rng)
    assert {failure for failure, _ in first} == set(range(FEWEST))
    table = OutcomeTable()
    for number in range(100 * DEPTH):
        table.add(number % FEWEST, (0, 1, 2, 4), False)
    later = propose(RoundPlan(200, 10), SPACE, table, None, features, rng)
    beyond = [failure for failure, _ in later if failure >= FEWEST]  # the first ones have been given up
    assert set(beyond) == set(range(FEWEST, 100))
    assert len(beyond) > 0.6 * len(later)


def test_a_search_looks_further_than_at_the_first_macro_that_helped():
    """Small rounds went to the hard failures alone: four of eight searches stayed with one that helps at a third."""
    rng, features, table = np.random.default_rng(0), np.zeros((500, 1)), OutcomeTable()
    space = MacroSpace(primitives=12, options=3, longest=8)
    for number in range(30):
        table.add(number, (0, 1, 12), number % 3 == 0)
    trials = []
    for _ in range(20):
        proposed = propose(RoundPlan(50, 60), space, table, None, features, rng)
        assert 40 <= len(proposed) <= 50
        for failure, macro in proposed:
            table.add(failure, macro, macro == (0, 1, 12) and failure % 3 == 0)
        trials += proposed
    anywhere = [macro for failure, macro in trials if failure >= FEWEST]
    assert len(anywhere) > 0.6 * len(trials)
    assert len({macro for macro in anywhere if macro != (0, 1, 12)}) > 0.15 * len(trials)
    assert anywhere.count((0, 1, 12)) > 0.1 * len(trials)  # known ones are measured where they were not met before


def test_a_short_macro_is_not_forgotten_because_it_failed_once():
    """It helps at a third of the failures; the search met it again 2,200 trials after its first one had failed."""
    rng, features, table = np.random.default_rng(0), np.zeros((500, 1)), OutcomeTable()
    space = MacroSpace(primitives=12, options=3, longest=8)
    table.add(0, (3, 14), False)
    for number in range(60):
        table.add(number, (4, 4, 12), number == 7)
    tries = 0
    for _ in range(12):
        proposed = propose(RoundPlan(50, 60), space, table, None, features, rng)
        tries += sum(macro == (3, 14) for _, macro in proposed)
        for failure, macro in proposed:
            table.add(failure, macro, macro == (3, 14) and failure % 3 == 0)
    assert tries > 20
    assert table.winners(1) == [(3, 14)]


def test_short_macros_are_all_of_one_primitive_at_most():
    assert sorted(MacroSpace(primitives=2, options=2, longest=8).short()) == [
        (0, 2), (0, 3), (1, 2), (1, 3), (2,), (3,)
    ]  # fmt: skip


def test_of_new_macros_the_trees_pick_one():
    """Macros with primitive 0 help everywhere, others nowhere: of those that are drawn anew, more have it."""
    rng, features, table = np.random.default_rng(0), np.zeros((300, 1)), OutcomeTable()
    space = MacroSpace(primitives=8, options=2, longest=6)
    for number in range(300):
        macro = space.random(rng)
        table.add(number, macro, 0 in macro)
    model = SuccessModel.fit(features, table, space, 0)
    chances = model.probability(features[:2], [(0, 8), (1, 9)])
    np.testing.assert_array_equal(model.of_pairs(features[:2], [(0, 8), (1, 9)]), np.diag(chances))
    known, shares = set(table.macro), []
    for each in (None, model):
        trials = propose(RoundPlan(200, 1), space, table, each, features, np.random.default_rng(1))
        new = [macro for _, macro in trials if macro not in known and len(macro) > 2]
        assert len(new) > 20
        shares.append(np.mean([0 in macro for macro in new]))
    assert shares[1] > shares[0] + 0.2


def test_few_failures_leave_every_kind_of_trial_its_share():
    """Each failure got one such trial of a round, the random ones first: with 30 failures nothing else came."""
    rng, features, table = np.random.default_rng(0), np.zeros((30, 1)), OutcomeTable()
    space = MacroSpace(primitives=12, options=3, longest=8)
    seen = ((0, 1, 12), (2, 3, 13))
    for number in range(300):
        table.add(number % 30, space.random(rng), False)
    for number in range(8):
        table.add(number, seen[number % 2], number % 4 < 2)
    trials = propose(RoundPlan(200, 60), space, table, None, features, rng)
    near = [macro for _, macro in trials if any(abs(len(macro) - 3) < 2 and set(macro) & set(one) for one in seen)]
    assert len(trials) > 100
    assert sum(macro in seen for _, macro in trials) > 20
    assert len(near) > 60


def test_a_macro_that_is_promising_is_raced_before_one_that_is_known_to_be_worse():
    table = OutcomeTable()
    for number in range(40):
        table.add(number, (0, 4), number % 3 == 0)
        table.add(number, (1, 4), number % 2 == 0)
    table.add(0, (2, 4), True)
    rng = np.random.default_rng(0)
    drawn = [promising(table, [(0, 4), (1, 4), (2, 4)], rng) for _ in range(600)]
    assert drawn.count((0, 4)) < drawn.count((1, 4))
    assert drawn.count((2, 4)) > 100


def test_the_search_ends_where_every_macro_has_been_tried():
    space, table = MacroSpace(primitives=1, options=1, longest=1), OutcomeTable()
    for failure in range(3):
        for macro in ((1,), (0, 1)):
            table.add(failure, macro, False)
    assert propose(RoundPlan(9, 5), space, table, None, np.zeros((3, 1)), np.random.default_rng(0)) == []


def test_one_macro_is_learnt_from_for_each_failure():
    """By rates alone: what is best everywhere where it recovered, another that did elsewhere, else a first decision."""
    table, ways = OutcomeTable(), {}
    for failure, macro, well in ((0, (0, 4), True), (0, (1, 5), True), (1, (0, 4), True), (1, (1, 5), False)):
        table.add(failure, macro, well)
        ways[failure, macro] = np.full((len(macro), 1), 10.0 * failure + macro[0])
    memory = SearchMemory(table, ways, np.random.default_rng(0))
    starts, one_world = np.array([[7.0], [8.0], [9.0]]), np.zeros(3, dtype=np.int64)
    states, taken, counts = memory.examples(None, np.zeros((3, 1)), starts, 9, one_world)
    assert_array_equal(states[:, 0], [0.0, 0.0, 10.0, 10.0, 9.0])
    assert_array_equal(taken, [0, 4, 0, 4, 0])
    assert_array_equal(counts, 1.0)


class _Believed:
    """A model that believes what it is told, whatever macros are asked for (sorted as they are asked for)."""

    def __init__(self, beliefs):
        self.beliefs = np.array(beliefs)

    def probability(self, features, macros):
        return self.beliefs.copy()


def test_what_is_best_in_its_world_is_learnt_from_unless_another_is_clearly_better():
    """(0, 4) is the best of both worlds together; in the second world (1, 5) is, and is preferred there alone."""
    table = OutcomeTable()
    for failure in range(4):
        table.add(failure, (0, 4), True)
    for failure in (2, 3):
        table.add(failure, (1, 5), True)
    assert table.winners(9) == [(0, 4), (1, 5)]
    memory, features, starts = SearchMemory(table, {}, np.random.default_rng(0)), np.zeros((4, 1)), np.zeros((4, 1))
    model = _Believed([[0.9, 0.1], [0.5, 0.55], [0.52, 0.5], [0.3, 0.5]])
    for worlds, first_decisions in (([0, 0, 0, 0], [0, 0, 0, 1]), ([0, 0, 1, 1], [0, 0, 1, 1])):
        _, taken, _ = memory.examples(model, features, starts, 9, np.array(worlds))
        assert_array_equal(taken, first_decisions)


def test_the_network_learns_what_it_is_shown(task):
    card = card_of(task, make_learner("search", task, Limits()), "search", "hash")
    scale = card.normalisation
    states = scale.centre + scale.scale * np.random.default_rng(0).normal(size=(200, len(card.columns)))
    actions = np.where(states[:, 0] > scale.centre[0], 2, 5)
    policy = clone(card, states, actions, np.ones(200), (64,), updates=1500, batch=64, seed=0)
    assert (policy.act(states) == actions).mean() > 0.95
    again = clone(card, states, actions, np.ones(200), (64,), updates=1500, batch=64, seed=0)
    assert all(torch.equal(again.weights[name], weight) for name, weight in policy.weights.items())


def test_an_outcome_is_that_of_a_run_of_its_own(task):
    """Beside other trials in the pool, or alone in the policy's own loop: the same outcome, states and steps."""
    nominal, limits = task.nominal, Limits(decisions=4)
    rng = np.random.default_rng(3)
    space = MacroSpace(len(PRIMITIVES), len(nominal), 3)
    failure = rng.integers(len(task.failures), size=24)
    macros = padded([space.random(rng) for _ in failure], limits.decisions)
    given_args = task.world, nominal, PRIMITIVES, task.failures
    trials = run_trials(*given_args, failure, macros, limits, slots=5)
    assert 0 < trials.success.sum() < len(trials)
    wide = run_trials(*given_args, failure, macros, limits, slots=24)
    for one in ("actions", "states", "success", "steps"):
        assert_array_equal(getattr(trials, one), getattr(wide, one))
    starts = first_state(task.world, task.failures, limits).values
    assert_allclose(trials.states[:, 0], starts[failure])
    for row in range(0, len(trials), 4):
        count = iter(macros[row])
        agent = Agent(limits, tuple(PRIMITIVES), lambda states, todo=count: np.array([next(todo)]))
        alone = recover(task.world, nominal, agent, task.failures.take(failure[[row]]))
        assert alone.success[0] == trials.success[row]
        assert alone.steps[0] == trials.steps[row]
        done = trials.actions[row][trials.actions[row] >= 0]
        assert_array_equal(alone.actions[0, : len(done)], done)


class KilledError(Exception):
    """As if the process had been killed."""


def searched(task, folder, kill_at=()):
    """Search from nothing, or from what is in `folder`; stop after each checkpoint whose number is in `kill_at`."""
    settings = TrainSettings(4000, 8, 600, 4, PPOSettings(n_steps=24, batch_size=12, hidden=(16,)))
    saved, seen = search_module.save_checkpoint, 0
    rows = []

    def killing(*what):
        nonlocal seen
        saved(*what)
        seen += 1
        if seen in kill_at:
            raise KilledError

    while True:
        learner = make_learner("search", task, Limits(), {"trials": 16, "updates": 600, "longest": 4})
        card = card_of(task, learner, "search", "hash")
        torch.manual_seed(99)
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(search_module, "save_checkpoint", killing)
            try:
                apart = task.failures.take(range(4))
                done = search_train(
                    task, learner, learner.search, apart, settings, card, folder, lambda *row: rows.append(row)
                )
            except KilledError:
                continue
        return done, (folder / "policy.safetensors").read_bytes(), rows


def test_a_search_that_was_killed_comes_to_the_same_policy_to_the_bit_and_recovers(task, tmp_path):
    whole, policy, rows = searched(task, tmp_path / "whole")
    assert len(whole.evaluations) > 3
    assert 3000 < whole.control_steps <= 4000 + 200  # less than a quarter of a round is left over
    often, again, resumed = searched(task, tmp_path / "often", kill_at=(1, 2, 4))
    assert again == policy
    assert [kind for kind, _ in resumed].count("resumed") == 3
    for table in ("rounds", "evaluations"):
        assert getattr(often, table) == getattr(whole, table)
    for key, value in whole.tensors.items():
        assert torch.equal(often.tensors[key], value), key
    agent, kept = load_agent(tmp_path / "whole", task.world, task.nominal, task.failures)
    assert kept.card.actions == action_names(PRIMITIVES, task.nominal)
    others = recover(task.world, task.nominal, agent, task.failures)
    every, limits = np.arange(len(task.failures)), agent.limits
    own = len(PRIMITIVES)
    alike = [  # an option for all failures alike: what a policy that has learnt nothing of them may do
        run_trials(task.world, task.nominal, PRIMITIVES, task.failures, every, options, limits, slots=64).success.mean()
        for options in (padded([(own + option,)] * len(every), limits.decisions) for option in range(2))
    ]
    assert others.success.mean() >= 0.9 * max(alike) > 0.3
    assert {kind for kind, _ in rows} == {"round", "evaluation"}


def test_a_search_that_finds_nothing_is_a_result_too(task, tmp_path):
    """It was an error after all the compute, and the other learners and seeds of a comparison were lost with it."""
    learner = make_learner("search", task, Limits(), {"trials": 1, "updates": 2000, "longest": 4})
    settings = TrainSettings(5, 8, 600, 4, PPOSettings(n_steps=24, batch_size=12, hidden=(16,)))
    card = card_of(task, learner, "search", "hash")
    apart = task.failures.take(range(4))
    done = search_train(task, learner, learner.search, apart, settings, card, tmp_path, lambda *row: None)
    assert not any(row["done"] for row in done.rounds)
    assert len(done.evaluations) == 1
    agent, policy = load_agent(tmp_path, task.world, task.nominal, task.failures)
    [macro] = load_macros(tmp_path, policy.card.actions, 9)
    assert set(agent.act(first_state(task.world, task.failures, Limits()).values)) == {macro[0]}


def test_a_search_that_has_found_nothing_yet_goes_on_where_it_was_killed(task, tmp_path):
    """Its first checkpoint waited for the first recovery."""
    learner = make_learner("search", task, Limits(), {"trials": 3, "updates": 10, "longest": 4})
    settings = TrainSettings(20, 8, 600, 4, PPOSettings(n_steps=24, batch_size=12, hidden=(16,)))
    card = card_of(task, learner, "search", "hash")
    run = learner, learner.search, task.failures.take(range(4)), settings, card, tmp_path
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(search_module._Run, "evaluate", lambda run: (_ for _ in ()).throw(KilledError))
        with pytest.raises(KilledError):
            search_train(task, *run, lambda *row: None)
    kinds = []
    search_train(task, *run, lambda kind, row: kinds.append(kind))
    assert kinds == ["resumed", "evaluation"]


def test_a_round_that_is_larger_than_the_budget_is_cut_to_it(task, tmp_path):
    learner = make_learner("search", task, Limits(), {"trials": 10**6, "updates": 10, "longest": 4})
    settings = TrainSettings(2500, 8, 600, 4, PPOSettings(n_steps=24, batch_size=12, hidden=(16,)))
    card = card_of(task, learner, "search", "hash")
    apart = task.failures.take(range(4))
    done = search_train(task, learner, learner.search, apart, settings, card, tmp_path, lambda *_: None)
    assert 1500 < done.control_steps <= 2500 + 200


def test_bad_settings_are_refused(task):
    for params, message in (
        ({"trials": 0}, "search: trials must be an integer of at least 1, got 0"),
        ({"longest": 2.5}, "search: longest must be an integer of at least 1, got 2.5"),
        ({"longest": 10}, r"longest \(10\) leaves no decision of limits\.decisions \(10\).*give at most 9"),
    ):
        with pytest.raises(ConfigError, match=message):
            make_learner("search", task, Limits(), params)
