import numpy as np
import pytest

from p2l.domains.insertion.domain import InsertionDomain, RepsSettings
from p2l.domains.insertion.factory import board, insertion, insertion_continuous
from p2l.domains.insertion.layouts import make_tasks
from p2l.domains.insertion.physics import InsertionPhysics, build_model, is_inserted, start_states
from p2l.domains.insertion.rollouts import TIMING, Rollouts
from p2l.domains.insertion.waypoints import execute
from p2l.errors import ConfigError, ShapeError
from p2l.sim.batch import Engine


def wall_task(distance_m, side="bottom"):
    wall = {"bottom": [0.0, -distance_m - 0.005, 0.06, 0.005], "left": [-distance_m - 0.005, 0.0, 0.005, 0.06]}
    return make_tasks(["slot"], [0], [np.array([wall[side]])])


@pytest.fixture(scope="module")
def learnt():
    """A block skill for a slot 1.1 cm above a wall, learnt with the default budget."""
    domain = insertion()
    skill = domain.learn(wall_task(0.011), np.array([0]), np.random.default_rng(3))
    return domain, skill


def rate(domain, skill, task, draws=60):
    return domain.evaluate(skill, task, task, draws, np.random.default_rng(9)).mean()


def test_reps_turns_a_failing_demonstration_into_a_skill(learnt):
    domain, skill = learnt
    shown = domain.demonstrate(wall_task(0.011), np.random.default_rng(0))
    assert rate(domain, shown, wall_task(0.011)) < 0.3
    assert rate(domain, skill, wall_task(0.011)) > 0.85


def test_the_skill_needs_its_wall(learnt):
    domain, skill = learnt
    assert rate(domain, skill, domain.without_walls(wall_task(0.011))) < 0.2


def test_the_skill_carries_over_to_the_same_distance_only(learnt):
    domain, skill = learnt
    assert rate(domain, skill, wall_task(0.014)) < 0.2
    assert rate(domain, skill, wall_task(0.011, "left")) < 0.2


def test_a_peg_skill_from_the_far_row_serves_the_near_row_but_not_the_reverse():
    """The asymmetry behind table 3.1, from contact physics alone."""
    domain = board()
    far, near = wall_task(0.021), wall_task(0.009)
    far_skill = domain.learn(far, np.array([0]), np.random.default_rng(0))
    near_skill = domain.learn(near, np.array([0]), np.random.default_rng(1))
    assert rate(domain, far_skill, far) > 0.9
    assert rate(domain, near_skill, near) > 0.9
    assert rate(domain, far_skill, near) > 0.7
    assert rate(domain, near_skill, far) < 0.1


def test_learning_and_evaluating_repeat_to_the_bit_on_any_number_of_threads():
    results = []
    for nthread in (1, 2):
        domain = InsertionDomain(reps=RepsSettings(updates=1, samples=6, validation_draws=4), nthread=nthread)
        tasks = domain.sample_tasks(np.random.default_rng(0), 3)
        skills = domain.learn(tasks, np.array([0, 2]), np.random.default_rng(1))
        results.append((skills, domain.evaluate(skills, tasks, tasks, 2, np.random.default_rng(2))))
    np.testing.assert_array_equal(results[0][0], results[1][0])
    np.testing.assert_array_equal(results[0][1], results[1][1])


def test_estimate_errors_are_shared_by_all_skills(learnt):
    domain, skill = learnt
    twice = domain.evaluate(
        np.repeat(skill, 2, axis=0), wall_task(0.011), wall_task(0.011), 5, np.random.default_rng(4)
    )
    np.testing.assert_array_equal(twice[0], twice[1])


def test_waypoints_start_from_where_the_end_effector_stands():
    """Pushed against a wall, then told to come back 4 mm: starts 7 mm apart end within about 1 mm of each other.

    What is left is the tilt of the part, which is pressed harder where the wall was reached sooner.
    """
    physics = InsertionPhysics()
    model = build_model(np.array([[0.0, -0.025, 0.06, 0.005]]), physics)
    skills = np.zeros((2, 2, 4))
    skills[:, 0, 1], skills[:, 1, 1] = -0.04, 0.004
    skills[..., 3] = np.log10(500.0)
    with Engine([model], control_period_s=physics.control_period_s, nthread=1) as engine:
        states = start_states(engine, np.array([[0.0, 0.004], [0.0, -0.003]]), physics)
        last, trace = execute(
            engine,
            states,
            skills,
            np.zeros(2, np.int64),
            TIMING,
            position_sensor="grip_pos",
            keep_trace=True,
        )
        ended = engine.sensor(last, "grip_pos")[:, -1, 1]
    assert trace.states.shape[:2] == (2, 17)
    assert abs(ended[0] - ended[1]) < 1.2e-3
    assert (ended < 0.0).all()
    with pytest.raises(ShapeError, match=r"expected \[2, W, 4\]"), Engine([model], control_period_s=0.048) as engine:
        execute(engine, states, skills[:1], np.zeros(2, np.int64), TIMING, position_sensor="grip_pos")


def test_insertion_is_a_matter_of_depth():
    depths = np.array([[0.0, 0.0, -0.014], [0.0, 0.0, -0.0151], [0.0, 0.0, 0.01]])
    np.testing.assert_array_equal(is_inserted(depths, InsertionPhysics()), [False, True, False])


def test_how_pairs_are_seen_is_chosen_by_layout_and_changes_no_task():
    assert [make().encoding for make in (insertion, insertion_continuous, board)] == ["walls", "walls", "difference"]
    assert insertion(encoding="difference").encoding == "difference"
    samples = [insertion(encoding=name).sample_set(np.random.default_rng(3), 5) for name in (None, "difference")]
    np.testing.assert_array_equal(samples[0].features, samples[1].features)


def test_the_continuous_variant_has_names_and_tasks_of_its_own():
    domain = insertion_continuous()
    assert domain.name == "insertion_continuous"
    tasks, other = (one.sample_tasks(np.random.default_rng(0), 20) for one in (domain, insertion()))
    on_lattice = np.isin(np.round(other.features[:, :4], 6), [1.1, 2.0, 2.9, 4.0]).all(axis=1)
    assert on_lattice.all()
    assert not np.isin(np.round(tasks.features[:, :4], 6), [1.1, 2.0, 2.9]).any()


def test_unknown_settings_are_refused():
    with pytest.raises(ConfigError, match="unknown RepsSettings settings"):
        insertion(reps={"sample": 3})
    with pytest.raises(ConfigError, match="known layouts: grid, board"):
        insertion(layout="sphere")
    with pytest.raises(ConfigError, match="known ones: difference, concatenation, walls"):
        insertion(encoding="wall")
    with pytest.raises(ConfigError, match="rising range"):
        insertion(board_distance_m=[0.02, 0.01])
    for wrong in (
        {"noise_std": float("nan")},
        {"physics": {"friction": "x"}},
        {"reps": {"updates": -1}},
        {"nthread": 0},
    ):
        with pytest.raises(ConfigError, match="must be"):
            insertion(**wrong)
    assert board(physics={"friction": 0.4}).physics.tip == "peg"
    with pytest.raises(ConfigError, match="unknown tip"):
        Rollouts(insertion(physics={"tip": "cone"}).physics, nthread=1).model(wall_task(0.01), 0)
