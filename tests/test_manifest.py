"""The manifest: every CSV, PNG, YAML and film of a folder as it was written, and what is told of a change."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from p2l.artifacts import load_json, save_json
from p2l.errors import ArtifactError
from p2l.manifest import FILE, check_place, read_checked, write_manifest

NAMES = ("table.csv", "graphs/s0.png", "videos/a.mp4", "door/plan.yaml")


@pytest.fixture
def folder(tmp_path):
    for name in (*NAMES, "facts.json", "runs/s0/config.yaml", "records/x.csv", ".hidden/y.csv", "config.yaml"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(f"content of {name}\n")
    write_manifest(tmp_path, frozenset({"config.yaml"}))
    return tmp_path


def test_outputs_without_a_digest_of_their_own_are_in_it_and_nothing_else(folder):
    assert sorted(load_json(folder / FILE, schema="manifest", version=1)["files"]) == sorted(NAMES)
    for name in NAMES:
        assert read_checked(folder / name, "make it").decode() == f"content of {name}\n"
    for name in ("config.yaml", "runs/s0/config.yaml"):
        with pytest.raises(ArtifactError, match="is none of the files"):
            read_checked(folder / name, "make it")


@given(st.sampled_from(NAMES), st.integers(0, 10))
def test_every_change_is_noticed(tmp_path_factory, name, cut):
    folder = tmp_path_factory.mktemp("folder")
    for each in NAMES:
        (folder / each).parent.mkdir(parents=True, exist_ok=True)
        (folder / each).write_text(f"content of {each}\n")
    write_manifest(folder)
    content = (folder / name).read_bytes()
    (folder / name).write_bytes(content[:cut])
    with pytest.raises(ArtifactError, match=r"not as its stage wrote it.*; make it"):
        read_checked(folder / name, "make it")
    (folder / name).unlink()
    with pytest.raises(ArtifactError, match=r"cannot be read.*; make it"):
        read_checked(folder / name, "make it")


def test_a_damaged_or_missing_manifest_is_told(folder):
    (folder / FILE).write_text((folder / FILE).read_text().replace("table", "tabel"))
    with pytest.raises(ArtifactError, match=r"manifest\.json: content does not match its digest"):
        read_checked(folder / "table.csv", "make it")
    (folder / FILE).unlink()
    with pytest.raises(ArtifactError, match=r"table\.csv: no manifest\.json says"):
        read_checked(folder / "table.csv", "make it")


def test_a_manifest_of_another_program_is_not_overwritten(tmp_path):
    check_place(tmp_path)
    (tmp_path / FILE).write_text('{"name": "an extension of a browser"}')
    with pytest.raises(ArtifactError, match=r"name another hydra\.run\.dir"):
        check_place(tmp_path)
    save_json(tmp_path / FILE, {"files": {}}, schema="manifest", version=1)
    check_place(tmp_path)


def test_a_folder_without_such_files_gets_none(tmp_path):
    (tmp_path / "facts.json").write_text("{}")
    write_manifest(tmp_path)
    assert not (tmp_path / FILE).exists()
