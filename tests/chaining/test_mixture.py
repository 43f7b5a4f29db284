"""A search that practises in several worlds at once."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from examples.push.world import Push
from p2l.chaining.agent import load_agent
from p2l.chaining.learners.table import make_learner
from p2l.chaining.mdp import Limits
from p2l.chaining.ppo import PPOSettings
from p2l.chaining.search.macros import MacroSpace, padded
from p2l.chaining.search.mixture import mixture_of
from p2l.chaining.search.train import search_train
from p2l.chaining.search.trials import run_trials
from p2l.chaining.states import first_state
from p2l.chaining.train import TrainSettings, card_of, summary
from p2l.contracts.observation import Observation
from p2l.errors import ConfigError
from p2l.skills.primitives import PRIMITIVES

LIMITS = Limits(decisions=4)


@pytest.fixture
def varied(task):
    """The task, whose world can be made with other parameters."""
    return replace(task, vary=lambda differs: Push(**{"nthread": 1, "sigma_m": 0.03, **differs}))


@pytest.fixture
def mixture(varied):
    others = {name: varied.vary({"sigma_m": sigma_m}) for name, sigma_m in (("better", 0.02), ("worse", 0.05))}
    return mixture_of(varied, others, 60, varied.failures.take(range(8)))


def test_one_world_keeps_its_failures_in_order(varied):
    alone = mixture_of(varied, {}, 60, varied.failures.take(range(3)))
    assert_array_equal(alone.row, np.arange(len(varied.failures)))
    assert not alone.ground.any()
    assert [len(one.failures) for one in alone.apart] == [3]
    state = first_state(varied.world, varied.failures, LIMITS)
    assert_array_equal(alone.states(LIMITS).values, state.values)
    assert alone.states(LIMITS).names == state.names
    assert alone.identity().shape == (len(alone), 0)


def test_every_failure_keeps_its_world_and_its_state(mixture):
    counts = [len(one.failures) for one in mixture.training]
    assert_array_equal(np.bincount(mixture.ground), counts)
    assert min(counts) > 3
    assert len(set(mixture.ground[: len(mixture) // 3].tolist())) == 3  # whichever are tried first, of all worlds
    values = mixture.states(LIMITS).values
    for index, one in enumerate(mixture.training):
        mine = mixture.ground == index
        assert_array_equal(np.sort(mixture.row[mine]), np.arange(counts[index]))
        assert_array_equal(values[mine], first_state(one.world, one.failures.take(mixture.row[mine]), LIMITS).values)
    assert [len(one.failures) for one in mixture.apart] == [8, 4, 4]
    assert_array_equal(mixture.identity().argmax(axis=1), mixture.ground)
    assert_array_equal(mixture.identity().sum(axis=1), 1.0)


def test_a_trial_ends_as_in_its_own_world_alone(mixture):
    rng = np.random.default_rng(1)
    space = MacroSpace(len(PRIMITIVES), len(mixture.training[0].nominal), 3)
    failure = rng.permutation(len(mixture))[:24]
    macros = padded([space.random(rng) for _ in failure], LIMITS.decisions)
    width = mixture.states(LIMITS).values.shape[1]
    together = mixture.trials(PRIMITIVES, failure, macros, LIMITS, width)
    assert_array_equal(together.failure, failure)
    assert 0 < together.success.sum() < len(failure)
    for place, each in enumerate(failure):
        one, row = mixture.training[mixture.ground[each]], mixture.row[[each]]
        alone = run_trials(one.world, one.nominal, PRIMITIVES, one.failures, row, macros[[place]], LIMITS, slots=1)
        for name in ("actions", "states", "success", "steps"):
            assert_array_equal(getattr(together, name)[place], getattr(alone, name)[0])


def test_a_search_in_several_worlds_is_judged_in_all_of_them(varied, tmp_path):
    params = {"trials": 16, "updates": 600, "longest": 4, "mixture": {"worse": {"sigma_m": 0.05}}, "executions": 40}
    learner = make_learner("search", varied, Limits(), params)
    settings = TrainSettings(4000, 8, 600, 4, PPOSettings(n_steps=24, batch_size=12, hidden=(16,)))
    card = card_of(varied, learner, "search", "hash")
    apart = varied.failures.take(range(4))
    done = search_train(varied, learner, learner.search, apart, settings, card, tmp_path, lambda *row: None)
    assert {row["episodes"] for row in done.evaluations} == {4}  # `success` is that of the task itself
    assert done.best == max(row["success_everywhere"] for row in done.evaluations) > 0.0
    assert summary(done)["last_evaluation"] == done.evaluations[-1]["success_everywhere"]  # comparable with the best
    for row in done.evaluations:  # of the two worlds, with as many failures set apart
        assert row["success_everywhere"] == pytest.approx((row["success"] + row["success:worse"]) / 2)
    assert done.told["failures:worse"] > done.told["set_apart:worse"] == 4
    agent, policy = load_agent(tmp_path, varied.world, varied.nominal, varied.failures)
    assert agent.limits == Limits()
    kept = max(done.evaluations, key=lambda row: (row["success_everywhere"], row["control_steps"]))
    assert policy.card.told["success:worse"] == kept["success:worse"]


def test_a_mixture_that_is_none_is_refused_before_anything_runs(task, varied):
    def refused(message, of, mixture, **others):
        with pytest.raises(ConfigError, match=message):
            make_learner("search", of, others.pop("limits", Limits()), {"mixture": mixture, **others})

    refused(r"mixture must name worlds by the parameters that differ", varied, ["bottle"])
    refused(r"mixture must name worlds by the parameters that differ", varied, {"bottle": {}})
    refused(r"mixture names no world; name some in conf/chaining/<world>\.yaml.*or say learner=search", varied, {})
    refused(r"a mixture needs a world that was made from parameters", task, {"worse": {"sigma_m": 0.05}})
    refused(r"search: mixture\.worse: .*sigma_m", varied, {"worse": {"sigma_m": -1.0}})
    refused(r"executions must be an integer of at least 1, got 0", varied, {}, executions=0)
    never = varied.vary({"sigma_m": 0.0})
    both = {"sure": never, "certain": never}
    with pytest.raises(ConfigError, match=r"in 5 executions of the mixture's sure, certain; leave .* or give more"):
        mixture_of(varied, both, 5, varied.failures.take([0]))


def test_a_world_whose_columns_lie_elsewhere_may_be_in_a_mixture(varied):
    """Another arm has other joints: every field after its angles lies elsewhere, and it was refused for all of them."""

    class Wider(Push):
        """Observes a further field before all others."""

        def observe(self, rows):
            seen = super().observe(rows)
            fields = {"more_m": np.zeros((len(rows), 2))} | {name: seen[name] for name in seen.columns}
            return Observation.of(fields)

    of = replace(varied, vary=lambda differs: Wider(**{"nthread": 1, "sigma_m": 0.03, **differs}))
    fields = tuple(varied.world.observe(varied.failures.take([0])).columns)
    mixture = {"mixture": {"wider": {"sigma_m": 0.03}}}
    learner = make_learner("search", of, Limits(fields=fields), mixture)
    assert_array_equal(
        first_state(learner.others["wider"], varied.failures, learner.limits).values,
        first_state(varied.world, varied.failures, learner.limits).values,
    )
    with pytest.raises(ConfigError, match=r"mixture\.wider: that world does not observe the task's fields alone"):
        make_learner("search", of, Limits(), mixture)
