"""Files of finished stages among the records: taken where they are whole and of the same settings, else made anew."""

import dataclasses

import numpy as np
import pytest

from p2l.archive import Archive, digest_of
from p2l.errors import ArtifactError
from p2l.ledger import Item
from p2l.schema import SCHEMAS, validate
from stages._archive import archive_of

NAMES = ("modes.npz", "tables/modes.csv")


def archive(records, identity="one"):
    return Archive(records, Item("door", "cluster", 0, 0, identity), NAMES)


def fill(folder, content):
    for name in NAMES:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content + name.encode())


def contents(folder):
    return {file.relative_to(folder).as_posix(): file.read_bytes() for file in folder.rglob("*") if file.is_file()}


def test_kept_files_come_back_byte_by_byte_and_those_of_other_settings_stay_beside(tmp_path):
    records, one, other = tmp_path / "records", tmp_path / "one", tmp_path / "other"
    assert not archive(records).restore(one)
    assert not one.exists()
    fill(one, b"1")
    archive(records).keep(one, seconds=2.0)
    assert not archive(records, "other").restore(other)
    fill(other, b"2")
    archive(records, "other").keep(other, seconds=2.0)
    for identity, made in (("one", one), ("other", other)):
        assert archive(records, identity).restore(tmp_path / "again")
        assert contents(tmp_path / "again") == contents(made)


def test_without_records_nothing_is_kept(tmp_path):
    fill(tmp_path, b"1")
    archive(None).keep(tmp_path, seconds=0.0)
    assert sorted(contents(tmp_path)) == sorted(NAMES)
    assert not archive(None).restore(tmp_path / "out")


@pytest.mark.parametrize("damage", ["cut", "gone", "record"])
def test_what_is_damaged_or_was_never_finished_is_made_anew(tmp_path, damage):
    records, out = tmp_path / "records", tmp_path / "out"
    fill(tmp_path / "made", b"1")
    archive(records).keep(tmp_path / "made", seconds=0.0)
    [file] = records.glob(f"files/*/{NAMES[0]}")
    if damage == "cut":
        file.write_bytes(file.read_bytes()[:-1])
    elif damage == "gone":
        file.unlink()
    else:  # killed between the files and the record that names them
        (records / "door-cluster-s0-b0.json").unlink()
    assert not archive(records).restore(out)
    assert not out.exists()
    archive(records).keep(tmp_path / "made", seconds=0.0)
    assert archive(records).restore(out)


def test_a_stage_that_left_a_file_out_cannot_be_kept(tmp_path):
    fill(tmp_path, b"1")
    (tmp_path / NAMES[1]).unlink()
    with pytest.raises(ArtifactError, match=r"modes\.csv: missing or empty"):
        archive(tmp_path / "records").keep(tmp_path, seconds=0.0)
    with pytest.raises(ArtifactError, match="no such artifact"):
        digest_of(tmp_path / NAMES[1])


@pytest.fixture
def cluster_config(tmp_path):
    """Configuration of `cluster`, by changes of its fields."""
    for name in ("train", "held_out", "preconditions"):
        np.savez(tmp_path / f"{name}.npz", name=np.array(name))
    base = {
        "seed": 0, "item": "door", "world": {"name": "door", "params": {"nthread": 1, "sigma_m": 0.02}},
        "failures": str(tmp_path / "train.npz"), "held_out": str(tmp_path / "held_out.npz"),
        "preconditions": str(tmp_path / "preconditions.npz"), "records": str(tmp_path / "records"),
        "modes": {"pessimistic": 6, "early_termination": 5, "first_flag": None}, "max_modes": 8, "covariance": "full",
        "regularisation": 0.01, "restarts": 10, "videos": True,
        "video": {"width": 320, "height": 240, "max_frames": 30, "hold_s": 0.5, "samples": 0},
    }  # fmt: skip
    return lambda **changes: validate({**base, **changes}, SCHEMAS["cluster"], "test")


def test_files_are_known_by_settings_and_inputs_and_not_by_threads_films_or_folders(tmp_path, cluster_config):
    def identity(**changes):
        return archive_of("cluster", 1, cluster_config(**changes), NAMES).item.config_hash

    first = identity()
    world = {"name": "door", "params": {"nthread": 2, "sigma_m": 0.02}}
    moved = tmp_path / "moved.npz"
    moved.write_bytes((tmp_path / "train.npz").read_bytes())
    for same in ({"world": world}, {"videos": False}, {"records": str(tmp_path)}, {"failures": str(moved)}):
        assert identity(**same) == first, same
    assert cluster_config(records=None).hash == cluster_config().hash
    for other in ({"restarts": 11}, {"seed": 1}, {"preconditions": None}, {"failures": str(tmp_path / "held_out.npz")}):
        assert identity(**other) != first, other
    assert archive_of("cluster", 2, cluster_config(), NAMES).item.config_hash != first
    item = archive_of("cluster", 1, cluster_config(), NAMES).item
    assert dataclasses.replace(item, config_hash="") == Item("door", "cluster", 0, 0, "")
