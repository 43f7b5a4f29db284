"""`make install` and the scripts touch nothing that is not theirs, wherever the checkout lies."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PLACES = [
    "robot work/p2l",
    "it's",
    "feature%2Fdoor",
    "Größe/ünï 機械",
    "a b/c  d",
    "$HOME",
    "x#y",
    "semi;colon",
    "(paren)",
]


def make(folder, *words):
    command = ["make", f"PYTHON={sys.executable}", *words]
    environment = {**os.environ, "PIP_NO_INDEX": "1"}
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, check=False)


@pytest.fixture(params=PLACES)
def checkout(request, tmp_path):
    """A checkout beside folders that its path, cut at a space, would name."""
    folder = tmp_path / request.param
    folder.mkdir(parents=True)
    shutil.copy(ROOT / "Makefile", folder)
    (folder / "requirements.lock").write_text("")
    for name in ("robot", "a", "x", "semi", ".venv"):
        (tmp_path / name).mkdir(exist_ok=True)
        (tmp_path / name / "thesis.txt").write_text("two years of work")
    return folder


def neighbours(tmp_path):
    return [name for name in ("robot", "a", "x", "semi", ".venv") if (tmp_path / name / "thesis.txt").is_file()]


def test_it_installs_under_any_path_and_leaves_its_neighbours_alone(checkout, tmp_path):
    """Without packages. `venv --clear` on a path cut at its space once emptied the folder beside the checkout."""
    for _ in range(2):  # the second time on what is there
        done = make(checkout, "venv")
        assert done.returncode == 0, done.stderr
    assert len(neighbours(tmp_path)) == 5
    place = [checkout / ".venv/bin/python", "-c", "import sys; print(sys.prefix)"]
    told = subprocess.run(place, capture_output=True, text=True, check=True)
    assert Path(told.stdout.strip()) == checkout / ".venv"
    script = subprocess.run([checkout / ".venv/bin/pip", "--version"], capture_output=True, text=True, check=True)
    assert str(checkout) in script.stdout
    assert "is up to date" not in make(checkout, "-n", "install").stdout


def test_an_environment_that_is_not_ours_is_left_alone(tmp_path):
    shutil.copy(ROOT / "Makefile", tmp_path)
    (tmp_path / "requirements.lock").write_text("")
    (tmp_path / ".venv").mkdir()
    (tmp_path / ".venv/mine.txt").write_text("mine")
    done = make(tmp_path, "install")
    assert done.returncode == 2
    assert f"{tmp_path}/.venv is there, and this Makefile did not make it; move it away" in done.stderr
    assert [file.name for file in (tmp_path / ".venv").iterdir()] == ["mine.txt"]


def test_a_path_that_cannot_work_is_refused_before_anything(tmp_path):
    folder = tmp_path / "a:b"
    folder.mkdir()
    shutil.copy(ROOT / "Makefile", folder)
    (folder / "requirements.lock").write_text("")
    done = make(folder, "install")
    assert done.returncode == 2
    assert "holds a colon or a line break" in done.stderr
    assert not (folder / ".venv").exists()


@pytest.mark.parametrize("kind", ["files", "repository"])
def test_the_thesis_script_refuses_a_folder_that_it_did_not_make(kind, tmp_path):
    mine = tmp_path / "my work"
    mine.mkdir()
    if kind == "repository":
        subprocess.run(["git", "init", "--quiet", mine], check=True)
    (mine / "notes.txt").write_text("mine")
    done = subprocess.run([ROOT / "scripts/thesis.sh", mine], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert f"{mine} " in done.stderr
    assert (mine / "notes.txt").read_text() == "mine"


def test_a_zip_download_is_told_before_anything_is_installed(tmp_path):
    """DVC's and the tests' own complaints came after the whole install."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    (tmp_path / "requirements.lock").write_text("")
    done = make(tmp_path, "test")
    assert done.returncode == 2
    assert "this is no git checkout (a ZIP download?)" in done.stderr
    assert not (tmp_path / ".venv").exists()
    assert "core.no_scm true" in make(tmp_path, "-n", "repro").stdout  # the pipeline needs none
