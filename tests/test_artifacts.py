"""What is written comes back; what is damaged, of another schema, or half-written does not."""

import contextlib
import json
import multiprocessing
import os
import signal
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from p2l import artifacts
from p2l.errors import ArtifactError

ARRAYS = st.dictionaries(
    st.from_regex(r"[a-z]{1,8}", fullmatch=True),
    hnp.arrays(
        st.sampled_from([np.float64, np.int64, np.bool_, np.uint8, np.dtype("<U5")]),
        hnp.array_shapes(min_dims=0, max_dims=3, max_side=4),
    ),
    max_size=4,
)
FACTS = st.dictionaries(
    st.text(max_size=6).filter(lambda key: key not in ("schema", "version", "digest")),
    st.recursive(
        st.none()
        | st.booleans()
        | st.integers()
        | st.floats(allow_nan=False, allow_infinity=False)
        | st.text(max_size=6),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=4), inner, max_size=3),
        max_leaves=8,
    ),
    max_size=5,
)


@given(ARRAYS)
def test_arrays_come_back(tmp_path_factory, arrays):
    path = tmp_path_factory.mktemp("arrays") / "a.npz"
    artifacts.save_arrays(path, arrays, schema="test", version=1)
    found = artifacts.load_arrays(path, schema="test", version=1)
    assert set(found) == set(arrays)
    for name, array in arrays.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


@given(FACTS)
def test_facts_come_back(tmp_path_factory, facts):
    path = tmp_path_factory.mktemp("facts") / "a.json"
    artifacts.save_json(path, facts, schema="test", version=1)
    assert artifacts.load_json(path, schema="test", version=1) == facts


def test_number_keys_come_back_as_text(tmp_path):
    artifacts.save_json(tmp_path / "a.json", {"levels": {10: 1, 9: 2}}, schema="test", version=1)
    assert artifacts.load_json(tmp_path / "a.json", schema="test", version=1) == {"levels": {"10": 1, "9": 2}}


def test_a_table_comes_back(tmp_path):
    table = pd.DataFrame({"task": ["a", "b"], "cost": [1.5, float("nan")], "n": [1, 2], "done": [True, False]})
    artifacts.save_table(tmp_path / "t.parquet", table, schema="test", version=1)
    pd.testing.assert_frame_equal(artifacts.load_table(tmp_path / "t.parquet", schema="test", version=1), table)


def test_a_network_comes_back_with_its_card(tmp_path):
    import torch

    state = {"weight": torch.arange(6.0).reshape(2, 3), "bias": torch.zeros(2)}
    artifacts.save_network(tmp_path / "n.safetensors", state, {"inputs": ["x"]}, schema="test")
    found, card = artifacts.load_network(tmp_path / "n.safetensors", schema="test")
    assert card == {"inputs": ["x"]}
    assert all(torch.equal(found[name], state[name]) for name in state)


def save_all(folder: Path) -> dict[str, object]:
    """One artifact of each kind, with the function that reads it."""
    import torch

    artifacts.save_arrays(folder / "a.npz", {"x": np.arange(200.0)}, schema="test", version=1)
    artifacts.save_json(folder / "a.json", {"x": "value", "n": 12345}, schema="test", version=1)
    artifacts.save_table(folder / "a.parquet", pd.DataFrame({"x": np.arange(200.0)}), schema="test", version=1)
    artifacts.save_network(folder / "a.safetensors", {"w": torch.arange(50.0)}, {}, schema="test")
    return {
        "a.npz": lambda path: artifacts.load_arrays(path, schema="test", version=1),
        "a.json": lambda path: artifacts.load_json(path, schema="test", version=1),
        "a.parquet": lambda path: artifacts.load_table(path, schema="test", version=1),
        "a.safetensors": lambda path: artifacts.load_network(path, schema="test"),
    }


@pytest.mark.parametrize("name", ["a.npz", "a.json", "a.parquet", "a.safetensors"])
def test_no_flipped_byte_passes_for_other_content(tmp_path, name):
    load = save_all(tmp_path)[name]
    whole = (tmp_path / name).read_bytes()
    intact = repr(load(tmp_path / name))
    for place in np.linspace(0, len(whole) - 1, 60).astype(int):
        damaged = bytearray(whole)
        damaged[place] ^= 0x55
        (tmp_path / name).write_bytes(bytes(damaged))
        with contextlib.suppress(ArtifactError):
            assert repr(load(tmp_path / name)) == intact  # bytes that carry nothing, such as a date in a zip header


@pytest.mark.parametrize("name", ["a.npz", "a.json", "a.parquet", "a.safetensors"])
@pytest.mark.parametrize("content", [b"", b"nonsense", b"[]", b"{}"])
def test_a_foreign_file_is_refused_by_name(tmp_path, name, content):
    load = save_all(tmp_path)[name]
    (tmp_path / name).write_bytes(content)
    with pytest.raises(ArtifactError, match=name):
        load(tmp_path / name)


@pytest.mark.parametrize("name", ["a.npz", "a.json", "a.parquet", "a.safetensors"])
def test_half_a_file_and_no_file_are_refused(tmp_path, name):
    load = save_all(tmp_path)[name]
    whole = (tmp_path / name).read_bytes()
    (tmp_path / name).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ArtifactError, match=name):
        load(tmp_path / name)
    (tmp_path / name).unlink()
    with pytest.raises(ArtifactError, match="no such artifact"):
        load(tmp_path / name)


def test_schema_and_version_must_match(tmp_path):
    artifacts.save_json(tmp_path / "a.json", {"x": 1}, schema="plans", version=2)
    with pytest.raises(ArtifactError, match="expected 'plans' version 3"):
        artifacts.load_json(tmp_path / "a.json", schema="plans", version=3)
    with pytest.raises(ArtifactError, match="holds schema 'plans'"):
        artifacts.load_json(tmp_path / "a.json", schema="tasks", version=2)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), np.float32(1), object()])
def test_what_json_cannot_hold_is_refused_and_nothing_is_written(tmp_path, value):
    with pytest.raises(ArtifactError, match=r"a\.json"):
        artifacts.save_json(tmp_path / "a.json", {"x": value}, schema="test", version=1)
    assert list(tmp_path.iterdir()) == []


def test_python_objects_are_never_pickled(tmp_path):
    with pytest.raises(ArtifactError, match="Python objects"):
        artifacts.save_arrays(tmp_path / "a.npz", {"x": np.array([{}])}, schema="test", version=1)
    np.savez(tmp_path / "b.npz", x=np.array([{}], dtype=object))
    with pytest.raises(ArtifactError):
        artifacts.load_arrays(tmp_path / "b.npz", schema="test", version=1)


def test_a_failed_write_leaves_the_old_file_alone(tmp_path):
    path = tmp_path / "a.txt"
    artifacts.write_text(path, "old")

    def fail():
        with artifacts.atomic(path) as temporary:
            temporary.write_text("half")
            raise RuntimeError

    with pytest.raises(RuntimeError):
        fail()
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.txt"]


def write_and_die(path: Path) -> None:
    with artifacts.atomic(path) as temporary:
        temporary.write_text("half")
        os.kill(os.getpid(), signal.SIGKILL)


def test_a_killed_write_leaves_the_old_file_alone(tmp_path):
    path = tmp_path / "a.txt"
    artifacts.write_text(path, "old")
    process = multiprocessing.get_context("fork").Process(target=write_and_die, args=(path,))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    assert path.read_text() == "old"


def test_a_written_file_is_readable_by_the_group_as_the_umask_says(tmp_path):
    umask = os.umask(0o022)
    try:
        artifacts.write_text(tmp_path / "a.txt", "x")
    finally:
        os.umask(umask)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o644


@given(st.dictionaries(st.text(max_size=4), st.integers() | st.text(max_size=4), min_size=2, max_size=4))
def test_a_config_hash_does_not_see_the_order_of_keys(config):
    turned = dict(reversed(config.items()))
    assert artifacts.config_hash(config) == artifacts.config_hash(turned)
    assert artifacts.config_hash(config) != artifacts.config_hash({**config, "another key": 1})


def test_the_envelope_is_plain_json(tmp_path):
    artifacts.save_json(tmp_path / "a.json", {"x": 1}, schema="test", version=1)
    assert json.loads((tmp_path / "a.json").read_text())["x"] == 1


def save_until_killed(path, at_rename):
    """Save networks of growing value; die at the given rename."""
    import torch

    count, replace = 0, Path.replace

    def killing(source, target):
        nonlocal count
        count += 1
        if count == at_rename:
            os.kill(os.getpid(), signal.SIGKILL)
        return replace(source, target)

    Path.replace = killing
    for value in range(10):
        artifacts.save_network(path, {"w": torch.full((3,), float(value))}, {"value": value}, schema="test")


@pytest.mark.parametrize("at_rename", range(3, 9))
def test_a_network_that_was_being_written_when_the_process_was_killed_is_whole(tmp_path, at_rename):
    """Its card was renamed before its weights, and a kill in between blocked the stage for good."""
    path = tmp_path / "net.safetensors"
    process = multiprocessing.get_context("fork").Process(target=save_until_killed, args=(path, at_rename))
    process.start()
    process.join()
    assert process.exitcode == -signal.SIGKILL
    weights, card = artifacts.load_network(path, schema="test")
    assert weights["w"].tolist() == [float(card["value"])] * 3
    assert card["value"] == (at_rename - 2) // 2
    artifacts.save_network(path, weights, card, schema="test")
    assert sorted(file.name for file in tmp_path.iterdir()) == ["net.safetensors", "net.safetensors.json"]


def test_what_another_process_is_writing_stays(tmp_path):
    with artifacts.atomic(tmp_path / "a.json") as mine:
        mine.write_text("mine")
        artifacts.write_text(tmp_path / "a.json", "other")
        assert mine.read_text() == "mine"
    assert (tmp_path / "a.json").read_text() == "mine"


def test_a_full_disk_is_one_message_and_nothing_half_written(tmp_path):
    if not Path("/dev/full").exists():
        pytest.skip("no /dev/full")
    artifacts.write_text(tmp_path / "a.txt", "old")

    def fill():
        with artifacts.atomic(tmp_path / "a.txt"), Path("/dev/full").open("w") as full:
            full.write("new")
            full.flush()

    with pytest.raises(ArtifactError, match=r"a\.txt: cannot be written \(No space left on device\)"):
        fill()
    assert [file.name for file in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"
    (tmp_path / "file").write_text("")
    with pytest.raises(ArtifactError, match="cannot be written"):
        artifacts.write_text(tmp_path / "file" / "a.txt", "new")
