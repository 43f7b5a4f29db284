"""Laws of the coverage simulation."""

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings
from numpy.testing import assert_array_equal

from p2l.domains.lego.domain import Lego
from p2l.domains.lego.parts import PARTS, STUD_CM, OverheadCamera, Part, photograph, rotate
from p2l.errors import ConfigError

EXACT = OverheadCamera(blur=1e-3, noise=0.0, flips=0.0, box=0.0, angle=0.0)
SILENT = Lego(tap_noise=0.0, slip=0.0, slip_angle=0.0, candidates=4000, camera=EXACT)
SMALL = Lego(candidates=2000)
SQUARE = Part("square", ((0, 0, 4, 4),))
taps = st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5)), min_size=2, max_size=5)
part_numbers = st.integers(0, len(PARTS) - 1)


def test_distance_to_a_square_by_hand():
    points = np.array([[0.0, 0.0], [1.6, 1.6], [2.6, 0.0], [4.6, 5.6]])
    np.testing.assert_allclose(SQUARE.distance(points), [0.0, 0.0, 1.0, 5.0], atol=1e-12)


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.name)
def test_cells_tile_the_part(part):
    studs = {
        (x, y) for c, r, w, h in part.bricks for x in range(c, c + w) for y in range(r, r + h)
    }  # the naive count of studs
    points = part.points(4)
    assert len(points) == 16 * len(studs)
    assert np.all(np.abs(points) < part.size / 2)
    columns, rows = zip(*studs, strict=True)
    span = np.array([max(columns) - min(columns) + 1, max(rows) - min(rows) + 1])
    np.testing.assert_allclose(part.size, span * STUD_CM)


def test_coverage_of_one_corner_tap_by_hand():
    lego = Lego(firm_radius=3.2)
    assert lego.coverage(_number("plate_8x8"), np.array([[[-3.2, -3.2]]]))[0] == pytest.approx(np.pi / 16, abs=0.005)


@given(part_numbers, taps)
def test_coverage_grows_with_taps_and_ignores_their_order(part, positions):
    sequence = np.array(positions)
    fewer, more, turned = (SILENT.coverage(part, taps[None]) for taps in (sequence[:-1], sequence, sequence[::-1]))
    assert fewer <= more
    assert more == turned


@given(part_numbers, taps, st.floats(0.0, 1.0))
def test_coverage_grows_with_the_radius(part, positions, extra):
    sequence = np.array(positions)[None]
    assert Lego(firm_radius=2.0).coverage(part, sequence) <= Lego(firm_radius=2.0 + extra).coverage(part, sequence)


def test_absent_taps_change_nothing_and_a_miss_fails():
    centre, absent, off = [[0.0, 0.0]], [[np.nan, np.nan]], [[-3.3, 0.0]]
    number = _number("plate_4x8")
    wide = Lego(firm_radius=5.0)  # -3.3 is 0.1 off the part and within the tool, -3.7 is not
    assert wide.firm(number, np.array([centre + absent, centre + off, [*centre, [-3.7, 0.0]]])).tolist() == [
        True,
        True,
        False,
    ]


@pytest.mark.parametrize("seed", range(3))
def test_without_noise_a_skill_solves_its_own_task(seed):
    rng = np.random.default_rng(seed)
    tasks = SILENT.sample_tasks(rng, len(PARTS))
    skills = SILENT.learn(tasks, np.arange(len(tasks)), rng)
    success = SILENT.evaluate(skills, tasks, tasks, 1, rng)[..., 0]
    assert success.diagonal().all()
    assert not success.all()


@settings(max_examples=20, deadline=None)
@given(st.integers(0, len(PARTS) - 1), st.floats(0.5, 2.0), st.integers(0, 2**32 - 1))
def test_scaling_every_length_changes_no_outcome(number, scale, seed):
    rng = np.random.default_rng(seed)
    taps = rng.uniform(-0.4, 0.4, (20, 3, 2)) * PARTS[number].size
    lego = Lego(firm_radius=3.0)
    larger = Lego(firm_radius=3.0 * scale)
    x, y = PARTS[number].points(4).T * scale
    scaled = ((taps[..., :1] * scale - x) ** 2 + (taps[..., 1:] * scale - y) ** 2 <= larger.firm_radius**2).any(axis=1)
    np.testing.assert_allclose(scaled.mean(axis=1), lego.coverage(number, taps), atol=2 / len(x))


def test_more_noise_lowers_the_success_on_the_own_task():
    rng = np.random.default_rng(0)
    tasks = SMALL.sample_tasks(rng, len(PARTS))
    skills = SMALL.learn(tasks, np.arange(len(tasks)), rng)
    rates = [
        Lego(tap_noise=noise)
        .evaluate(skills, tasks, tasks, 10, np.random.default_rng(1))
        .mean(axis=2)
        .diagonal()
        .mean()
        for noise in (0.1, 0.4, 0.8)
    ]
    assert rates[0] > 0.9
    assert rates[0] > rates[1] > rates[2]


def test_noise_is_shared_between_skills_and_outcomes_do_not_depend_on_neighbours():
    rng = np.random.default_rng(0)
    tasks = SMALL.sample_tasks(rng, len(PARTS))
    skills = SMALL.learn(tasks, np.array([2, 5, 9]), rng)
    rows = tasks.take([2, 5, 9])
    together = SMALL.evaluate(skills, rows, tasks, 4, np.random.default_rng(7))
    for k in range(3):
        alone = SMALL.evaluate(skills[k : k + 1], rows.take(k), tasks, 4, np.random.default_rng(7))
        assert_array_equal(alone[0], together[k])


def test_fewest_taps_on_known_parts():
    rng = np.random.default_rng(0)
    tasks = SILENT.sample_tasks(rng, len(PARTS))
    skills = SILENT.learn(tasks, np.arange(len(tasks)), rng)
    count = dict(zip([part.name for part in PARTS], np.isfinite(skills).sum(axis=1) // 2, strict=True))
    assert count["plate_4x8"] == 2  # 6.4 x 3.2 cm: half a diagonal is 3.6 cm, that of one half is 2.3 cm
    assert count["bar_2x16"] == 3  # 12.8 cm is longer than two discs of 6 cm
    assert count["plate_8x8"] == 4


def test_photograph_shows_the_part_where_the_box_says():
    rng = np.random.default_rng(0)
    camera = OverheadCamera()
    part = PARTS[_number("l_12x6")]
    views = photograph(part, camera, rng, 5)
    cells = (np.arange(camera.samples) + 0.5) / camera.samples - 0.5
    unit = np.stack(np.meshgrid(cells, cells, indexing="ij"), axis=-1)
    truth = part.distance(
        rotate(unit * views.size[:, None, None], views.angle[:, None, None]) + views.offset[:, None, None]
    )
    assert np.mean(views.image == (truth == 0)) > 0.93
    assert np.abs(views.size - part.size).max() < 1.0


def test_training_tasks_spread_evenly_and_sets_hold_different_parts():
    rng = np.random.default_rng(0)
    tasks = SMALL.sample_tasks(rng, 150)
    assert_array_equal(np.bincount(tasks.group), np.full(15, 10))
    assert tasks.features.shape == (150, 66)
    assert set(np.unique(tasks.features[:, :64])) == {0.0, 1.0}
    assert len(set(tasks.names)) == 150
    few = [SMALL.sample_tasks(rng, 17).group for _ in range(5)]
    assert all(set(np.bincount(group)) == {1, 2} for group in few)
    assert len({tuple(group) for group in few}) > 1
    sets = [SMALL.sample_set(rng, 10) for _ in range(5)]
    assert all(len(set(day.group)) == 10 for day in sets)
    assert len({tuple(day.group) for day in sets}) == 5


@pytest.mark.parametrize(
    "bad", [{"tap_noise": -1.0}, {"covered": 0.0}, {"max_taps": 0}, {"margin": 3.0}, {"slip": np.nan}]
)
def test_bad_parameters_are_refused(bad):
    with pytest.raises(ConfigError, match=next(iter(bad))):
        Lego(**bad)


def test_a_set_larger_than_the_ground_set_is_refused():
    with pytest.raises(ConfigError, match="15"):
        SMALL.sample_set(np.random.default_rng(0), 16)


def _number(name):
    return [part.name for part in PARTS].index(name)
