"""Strategies, decided by hand on the small push world: what follows which moment, and how skills are counted."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from p2l.errors import ArtifactError, ConfigError
from p2l.metareskill.episodes import EpisodeLedger, Place, episodes
from p2l.metareskill.record import load_recoveries, recoveries_hash, save_recoveries
from p2l.metareskill.strategies import STRATEGIES, playbook
from p2l.skills.chain import FINISH, Moments
from tests.metareskill import pushing_back as pb

ALIGN, PUSH = 0, 1
BEST = [[0.9, 0.2, 0.0], [0.0, 0.9, 0.0]]  # mode 0 recovers to align, mode 1 to push


def moments(rows, option, actions):
    count = len(rows)
    rows.actions[:] = actions
    zeros = np.zeros(count, dtype=np.int64)
    return Moments(np.arange(count), rows, np.full(count, option), zeros, zeros - 1, zeros, zeros, np.zeros(count))


@pytest.fixture(scope="module")
def made():
    world, task, nominal = pb.setting(estimator="exact")
    classifier = pb.modes(world)
    return world, task, nominal, classifier, pb.recoveries(task, classifier, BEST)


def book(made, strategy, **changes):
    _, task, nominal, classifier, learnt = made
    known = {"modes": classifier, "skills": learnt.skills} | changes
    return playbook(strategy, task, nominal, learnt.graph, learnt.timing, np.random.default_rng(0), **known)


def both(world):
    """Of two states, push may start in the first and only align in the second."""
    return pb.standing(world, [-0.08, -0.08], [0.0, 0.03])


def test_where_a_precondition_holds_all_but_open_loop_take_the_most_valuable_skill(made):
    for strategy in STRATEGIES[:-1]:
        found = book(made, strategy)
        assert found.choose(moments(both(made[0]), ALIGN, 1))[0] == PUSH
        assert found.choose(moments(both(made[0]), PUSH, 1))[1] == ALIGN
    assert_array_equal(book(made, "open_loop").choose(moments(both(made[0]), ALIGN, 1)), [PUSH, PUSH])


@pytest.mark.parametrize(
    ("strategy", "expected"),
    [
        ("recoveries", "recovery_0_align"),
        ("retry", "align"),
        ("to_previous", "to_align"),
        ("to_start", "to_align"),
        ("no_recovery", "align"),
        ("recoveries_repeating", "align"),
    ],
)
def test_a_skill_that_led_nowhere_gives_way_although_its_precondition_holds(made, strategy, expected):
    found = book(made, strategy)
    chosen = found.choose(moments(both(made[0]), ALIGN, 1))
    assert [found.options[index].name for index in chosen] == ["push", expected]


@pytest.mark.parametrize(
    ("strategy", "after_align", "after_push"),
    [
        ("retry", "align", "push"),
        ("to_previous", "to_align", "to_push"),
        ("to_start", "to_align", "to_align"),
        ("no_recovery", None, None),
    ],
)
def test_where_none_holds_a_heuristic_follows(made, strategy, after_align, after_push):
    found = book(made, strategy)
    names = [option.name for option in found.options]
    for last, expected in ((ALIGN, after_align), (PUSH, after_push)):
        [chosen] = found.choose(moments(pb.standing(made[0], 0.12, 0.08), last, 2))
        assert (names[chosen] if chosen != FINISH else None) == expected
    # After a motion back the skill it was meant for is still the last one.
    if strategy in ("to_previous", "to_start"):
        moved = names.index(after_push)
        assert_array_equal(found.choose(moments(pb.standing(made[0], 0.12, 0.08), moved, 3)), [moved])


def test_a_learnt_recovery_is_that_of_the_mode_with_the_best_value(made):
    found = book(made, "recoveries")
    chosen = found.choose(moments(pb.standing(made[0], [0.12, 0.12], [0.08, -0.08]), PUSH, 2))
    assert [found.options[index].name for index in chosen] == ["recovery_0_align", "recovery_1_push"]


def test_a_recovery_that_was_executed_gives_way_to_the_next_best_in_the_same_episode(made):
    """Mode 0 has two: to align, q = 0.9 (worth −5.42; −7.71 after once), and to push, q = 0.2 (−9.4)."""
    found = book(made, "recoveries")
    names = [option.name for option in found.options]
    assert names[2:] == ["recovery_0_align", "recovery_0_push", "recovery_1_push"]

    def lost(episodes):
        count = len(episodes)
        ended = moments(pb.standing(made[0], [0.12] * count, [0.08] * count), PUSH, 3)
        return [names[index] for index in found.choose(replace(ended, episode=np.array(episodes)))]

    assert lost([0, 4]) == ["recovery_0_align"] * 2
    assert lost([0]) == ["recovery_0_align"]
    assert lost([0]) == ["recovery_0_align"]
    assert "recovery_0_push" in [lost([0])[0] for _ in range(8)]
    assert lost([4, 1]) == ["recovery_0_align"] * 2  # other episodes know nothing of it


def test_an_episode_ends_when_the_task_is_done_or_ten_skills_were_executed(made):
    done, lost = pb.standing(made[0], 0.12, 0.0, done=True), pb.standing(made[0], 0.12, 0.08)
    for strategy in STRATEGIES[:-1]:
        assert_array_equal(book(made, strategy).choose(moments(done, PUSH, 2)), [FINISH])
        assert_array_equal(book(made, strategy).choose(moments(lost, PUSH, 10)), [FINISH])
    assert book(made, "retry").choose(moments(lost, PUSH, 9))[0] == PUSH


def test_where_no_recovery_is_feasible_learnt_recoveries_are_none(made):
    world, task, nominal, classifier, _ = made
    nothing = pb.recoveries(task, classifier, np.zeros((2, 3)))
    rng = np.random.default_rng(0)
    found = playbook(
        "recoveries", task, nominal, nothing.graph, pb.TIMING, rng, modes=classifier, skills=nothing.skills
    )
    assert found.options == nominal
    assert_array_equal(found.choose(moments(pb.standing(world, 0.12, 0.08), PUSH, 2)), [FINISH])


def test_unknown_strategies_and_missing_skills_are_refused(made):
    with pytest.raises(ConfigError, match="known: recoveries, retry"):
        book(made, "pray")
    with pytest.raises(ConfigError, match="needs failure modes"):
        book(made, "recoveries", skills=None)


def test_recoveries_are_known_by_their_trainings_and_not_by_last_bits(made):
    _, task, _, classifier, _ = made
    learnt = pb.recoveries(task, classifier, BEST)
    near = {key: replace(skill, parameters=np.nextafter(skill.parameters, 1.0)) for key, skill in learnt.skills.items()}
    elsewhere = replace(learnt, skills=near)
    assert recoveries_hash(elsewhere) != recoveries_hash(learnt)
    one, other = (replace(learnt, origin=origin) for origin in ("one", "other"))
    assert recoveries_hash(replace(elsewhere, origin="one")) == recoveries_hash(one) != recoveries_hash(other)


def test_recoveries_of_another_cluster_file_or_world_are_refused(made, tmp_path):
    world, task, _, classifier, learnt = made
    path = tmp_path / "recoveries.npz"
    save_recoveries(path, learnt)
    assert load_recoveries(path, world, task.preconditions, classifier).skills.keys() == learnt.skills.keys()
    other = type(classifier)(**{**vars(classifier), "weights": np.array([0.9, 0.1])})
    with pytest.raises(ArtifactError, match="learnt with another modes"):
        load_recoveries(path, world, task.preconditions, other)
    with pytest.raises(ArtifactError, match="another digest"):
        load_recoveries(path, pb.setting(sigma_m=0.02)[0], task.preconditions, classifier)


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    world, task, nominal = pb.setting()
    classifier = pb.modes(world)
    place = Place("push_back", "", world, task, nominal, episodes=12, slots=12)
    records = EpisodeLedger(tmp_path_factory.mktemp("records"), "", seed=5, max_options=4)

    def all_of(seed=0, q=BEST):
        learnt = pb.recoveries(task, classifier, q)
        return {name: episodes(records, place, name, seed, classifier, learnt) for name in STRATEGIES}

    return records, all_of


def test_episodes_are_counted_alike_and_start_alike(ran):
    _, all_of = ran
    found = all_of()
    for name, table in found.items():
        assert not table["diverged"].any(), name
        assert ((table["path_m"] > 0.0) & (table["options"] >= 1) & (table["options"] <= 4)).all(), name
        assert (table["recoveries"] <= table["options"]).all(), name
    assert (found["open_loop"]["options"] == 2).all()
    for name in ("open_loop", "no_recovery", "retry"):
        assert (found[name]["recoveries"] == 0).all()
    # Until no precondition holds, strategies agree; where it never comes to that, they do to the end.
    same = found["recoveries"]["recoveries"] == 0
    for column in ("success", "path_m", "options"):
        kept = same & (found["no_recovery"]["success"] | (found["no_recovery"]["options"] == 4))
        assert_array_equal(found["recoveries"][column][kept], found["no_recovery"][column][kept])
    assert found["no_recovery"]["success"].any()
    assert (found["recoveries"]["recoveries"] > 0).any()


def test_a_recorded_item_is_not_run_again_and_heuristics_do_not_depend_on_what_was_learnt(ran):
    records, all_of = ran
    first = all_of(seed=1)
    before = {path.name: path.stat().st_mtime_ns for path in records.records.iterdir()}
    again = all_of(seed=1, q=[[0.9, 0.3, 0.0], [0.0, 0.9, 0.0]])
    after = {path.name: path.stat().st_mtime_ns for path in records.records.iterdir()}
    assert not [name for name in before if before[name] != after[name]], "what is recorded is not overwritten"
    new = sorted(name.partition("-s1-b0-")[0] for name in set(after) - set(before))
    assert new == ["push_back-recoveries", "push_back-recoveries_repeating"]
    for name, table in first.items():
        assert table.equals(again[name])
