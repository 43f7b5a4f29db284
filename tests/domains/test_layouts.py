import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from p2l.domains.insertion.features import WALLS_PER_SCENE, task_features, wall_distances_cm
from p2l.domains.insertion.layouts import (
    CELL,
    WALLS_OF_ENVIRONMENT,
    board_layout,
    board_tasks,
    grid_environments,
    grid_slots,
    grid_walls,
    relative_walls,
    sample_board_tasks,
    sample_continuous_tasks,
    sample_grid_tasks,
)
from p2l.domains.insertion.physics import InsertionPhysics, build_model
from p2l.errors import ConfigError


def test_distances_by_hand():
    """A wall 2 cm to the left and one 1.5 cm below; the wall above is beside the part's strip and does not count."""
    walls = np.array([[-0.025, 0.0, 0.005, 0.03], [0.0, -0.02, 0.03, 0.005], [0.03, 0.02, 0.02, 0.005]])
    np.testing.assert_allclose(wall_distances_cm(walls), [2.0, 4.0, 1.5, 4.0])
    np.testing.assert_allclose(task_features(walls), [2.0, 4.0, 1.5, 4.0, 0.0, -1.5])


def test_equally_near_walls_share_the_offset():
    corner = np.array([[-0.016, 0.0, 0.005, 0.03], [0.0, 0.016, 0.03, 0.005]])
    np.testing.assert_allclose(task_features(corner), [1.1, 4.0, 4.0, 1.1, -1.1, 1.1])


@given(seed=st.integers(0, 1000))
@settings(max_examples=25, deadline=None)
def test_every_grid_slot_is_next_to_a_wall_and_clear_of_all(seed):
    tasks = sample_grid_tasks(np.random.default_rng(seed), 6, layout_seed=seed % 7, farthest_wall_cm=2.0)
    assert (tasks.features[:, :4].min(1) <= 2.0 + 1e-9).all()
    assert (tasks.features[:, :4].min(1) >= 1.1 - 1e-9).all()
    for walls, count in zip(tasks.payload["walls"], tasks.payload["wall_count"], strict=True):
        gap = np.abs(walls[:count, :2]) - walls[:count, 2:]
        assert (gap.max(1) > 0.006).all(), "a wall covers part of the slot"


@given(seed=st.integers(0, 1000))
@settings(max_examples=25, deadline=None)
def test_off_the_lattice_slots_keep_the_lattice_s_bounds_and_hardly_any_two_tasks_are_alike(seed):
    tasks = sample_continuous_tasks(np.random.default_rng(seed), 40, layout_seed=seed % 7, farthest_wall_cm=2.0)
    distances = tasks.features[:, :4]
    assert (distances.min(1) <= 2.0 + 1e-9).all()
    assert (distances.min(1) >= 1.1 - 1e-9).all()
    assert len(np.unique(np.round(tasks.features, 6), axis=0)) == 40
    for walls, count in zip(tasks.payload["walls"], tasks.payload["wall_count"], strict=True):
        gap = np.abs(walls[:count, :2]) - walls[:count, 2:]
        assert (gap.max(1) > 0.006).all(), "a wall covers part of the slot"


def test_off_the_lattice_slots_fill_the_square_that_the_lattice_spans():
    """Offsets from the cell's middle, found back from a wall's distance: none beyond 9 mm, and every tenth is met."""
    tasks = sample_continuous_tasks(np.random.default_rng(0), 400, layout_seed=0, farthest_wall_cm=2.9)
    left = tasks.features[tasks.features[:, 0] < 4.0, 0]
    offset = left / 100.0 - (CELL / 2 - 0.005)
    assert np.abs(offset).max() <= 0.009 + 1e-9
    assert (np.histogram(offset, np.linspace(-0.009, 0.009, 11))[0] > 0).all()
    assert set(tasks.group.tolist()) == {0, 1, 2, 3}


def test_a_distance_that_no_slot_has_is_refused():
    with pytest.raises(ConfigError, match="no slot has a wall within farthest_wall_cm = 1"):
        sample_continuous_tasks(np.random.default_rng(0), 1, layout_seed=0, farthest_wall_cm=1.0)


def test_the_environments_differ_in_their_number_of_walls():
    environments = grid_environments(0)
    assert [len(walls) for walls in environments] == list(WALLS_OF_ENVIRONMENT)
    for walls in environments:
        assert (np.abs(walls[:, :2]) <= 0.1).all()
        assert len({tuple(wall) for wall in walls}) == len(walls)
        assert len(grid_slots(walls, 2.0)) < len(grid_slots(walls, 4.0))
    with pytest.raises(ConfigError, match="allowed are 1 to 24"):
        grid_walls(np.random.default_rng(0), 25)


def test_features_do_not_change_when_slot_and_walls_move_together():
    walls = grid_environments(3)[2]
    slot = grid_slots(walls, 2.0)[5]
    shift = np.array([CELL, -CELL, 0.0, 0.0])
    moved = relative_walls(walls + shift, slot + shift[:2])
    np.testing.assert_allclose(wall_distances_cm(moved), wall_distances_cm(relative_walls(walls, slot)))


def test_the_board_has_seventeen_holes_on_two_offset_rows():
    walls, holes = board_layout()
    tasks = board_tasks()
    assert tasks.names == tuple(str(number) for number in range(17))
    nearest = tasks.features[:, :4].min(1)
    np.testing.assert_allclose(nearest[::2], 2.1, atol=1e-9)
    np.testing.assert_allclose(nearest[1::2], 0.9, atol=1e-9)
    assert (tasks.features[:, :4].argmin(1)[:12] == 2).all()
    assert (tasks.features[:, :4].argmin(1)[12:] == 1).all()
    apart = np.linalg.norm(holes[:, None] - holes[None], axis=-1) + np.eye(17)
    assert apart.min() > 0.013, "holes overlap"
    assert walls.shape == (2, 4)


def test_board_training_tasks_are_not_the_board():
    tasks = sample_board_tasks(np.random.default_rng(0), 200, (0.007, 0.025))
    nearest = tasks.features[:, :4].min(1)
    assert nearest.min() >= 0.7
    assert nearest.max() <= 2.5
    assert len(np.unique(nearest)) == 200
    assert set(tasks.group.tolist()) == {0, 1, 2, 3}


def test_too_many_walls_are_refused():
    with pytest.raises(ConfigError, match="at most 8"):
        build_model(np.tile([0.05, 0.0, 0.005, 0.01], (WALLS_PER_SCENE + 1, 1)), InsertionPhysics())
