"""The failure file: what goes in comes out, and nothing else is taken for it."""

import dataclasses

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from p2l.artifacts import load_arrays, save_arrays
from p2l.errors import ArtifactError, ConfigError, ShapeError
from p2l.failures.record import check_pair, check_params, check_world, load_failures, open_world, save_failures
from tests.failures.pushing import found


@pytest.fixture(scope="module")
def made():
    return found("pessimistic", sigma_m=0.03, episodes=20)


@pytest.fixture
def file(made, tmp_path):
    save_failures(tmp_path / "failures.npz", made[2].failures)
    return tmp_path / "failures.npz"


def test_what_is_saved_is_loaded(made, file):
    before, after = made[2].failures, load_failures(file, "train")
    assert after.origin == before.origin
    for name in ("start", "rows"):
        for key, value in getattr(before, name).arrays().items():
            assert_array_equal(getattr(after, name).arrays()[key], value)
    for name in ("truth", "seen"):
        assert dict(getattr(after, name).columns) == dict(getattr(before, name).columns)
        assert_array_equal(getattr(after, name).values, getattr(before, name).values)
    for name in ("option", "kind", "step", "time_s", "episode"):
        assert_array_equal(getattr(after, name), getattr(before, name))
    world, options = open_world(after, file)
    assert (world.digest, len(options)) == (made[0].digest, 2)


def test_equal_failures_give_equal_files(made, file, tmp_path):
    save_failures(tmp_path / "again.npz", made[2].failures)
    first, second = (load_arrays(path, schema="failures", version=1) for path in (file, tmp_path / "again.npz"))
    assert first.keys() == second.keys()
    assert all((first[key] == second[key]).all() for key in first)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.98])
def test_a_truncated_file_is_refused(file, share):
    data = file.read_bytes()
    file.write_bytes(data[: int(share * len(data))])
    with pytest.raises(ArtifactError, match=r"failures\.npz"):
        load_failures(file)


def test_other_files_are_refused(file):
    with pytest.raises(ArtifactError, match="no such artifact"):
        load_failures(file.with_name("nowhere.npz"))
    with pytest.raises(ArtifactError, match=r"holds the failures of split 'train'; expected 'held_out'"):
        load_failures(file, "held_out")
    arrays = load_arrays(file, schema="failures", version=1)
    save_arrays(file, arrays, schema="failures", version=0)
    with pytest.raises(ArtifactError, match="version 0; expected 'failures' version 1"):
        load_failures(file)


def test_a_file_that_holds_nan_is_refused(file):
    arrays = load_arrays(file, schema="failures", version=1)
    arrays["rows.states"][2, 5] = np.nan
    save_arrays(file, arrays, schema="failures", version=1)
    with pytest.raises(ShapeError, match="rows: states hold NaN"):
        load_failures(file)


def test_failures_of_another_world_or_version_are_refused(made, file):
    world, _, pushed = made
    failures = pushed.failures
    other = dataclasses.replace(failures, origin=dataclasses.replace(failures.origin, world="door"))
    with pytest.raises(ArtifactError, match="holds failures of world 'door', not of 'push'"):
        check_world(other, world, file)
    old = dataclasses.replace(failures, origin=dataclasses.replace(failures.origin, digest="0"))
    with pytest.raises(ArtifactError, match=r"another version of world 'push'.*stages\.discover"):
        check_world(old, world, file)
    with pytest.raises(ArtifactError, match="world 'push'; expected those of 'door'"):
        check_params(failures, "door", {}, file)
    with pytest.raises(ArtifactError, match=r"another variant of world 'push' \(sigma_m = 0.03, not 0.01\)"):
        check_params(failures, "push", {"sigma_m": 0.01}, file)
    with pytest.raises(ArtifactError, match=r"\(sigma_m = 0.03, not its default\)"):
        check_params(failures, "push", {}, file)
    check_params(failures, "push", {"sigma_m": 0.03, "nthread": 7, "estimator": "exact"}, file)
    check_params(failures, "push", {"sigma_m": 0.03, "block_y_m": (-0.05, 0.05)}, file)  # which is the default
    with pytest.raises(ConfigError, match=r"unknown parameters \['sigma'\]; allowed: estimator, "):
        check_params(failures, "push", {"sigma": 0.03}, file)


def test_held_out_failures_belong_to_the_training_failures(made, file):
    failures = made[2].failures
    later = dataclasses.replace(failures, origin=dataclasses.replace(failures.origin, split="held_out", seed=1))
    with pytest.raises(ArtifactError, match="has seed 1, the training failures 0; discover both in one run"):
        check_pair(failures, later, file)


def test_a_record_is_checked_at_birth(made):
    failures = made[2].failures
    with pytest.raises(ShapeError, match="option: axis 0"):
        dataclasses.replace(failures, option=failures.option[:-1])
    with pytest.raises(ShapeError, match="kind holds 7; there are 2"):
        dataclasses.replace(failures, kind=np.full(len(failures), 7))
    with pytest.raises(ValueError, match="read-only"):
        failures.step[0] = 1
