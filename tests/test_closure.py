"""Dependencies that are computed: what a stage imports, what `dvc.yaml` declares, and what the ledger hashes."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from p2l import closure as reading
from p2l.closure import closure, code_digest, outside_code
from p2l.errors import P2LError
from p2l.tracking.runs import RUN_FILE
from stages._bridge import TIMES_FILE
from stages._child import PARENT_FILE
from stages._stage import CONFIG_FILE, LOG_FILE

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = {"stages": ROOT / "stages"}
CODE = ("src/", "stages/")
BESIDES = {"config": {"src/p2l/schema"}}  # what is left out of all closures is what this stage is about


def declared():
    """Stage of `dvc.yaml` → module, and its dependencies on code."""
    stages = yaml.safe_load((ROOT / "dvc.yaml").read_text())["stages"]
    for name, stage in stages.items():
        module = re.search(r"python -m (stages\.\w+)", stage["cmd"]).group(1)
        yield name, module, [dep for dep in stage["deps"] if dep.startswith(CODE)]


def undeclared(module, deps):
    """Files that a stage imports and that lie under none of its dependencies."""
    files = [file.relative_to(ROOT).as_posix() for file in closure(module, PACKAGES)]
    return [file for file in files if not any(file == dep or file.startswith(f"{dep}/") for dep in deps)]


@pytest.mark.parametrize(("name", "module", "deps"), list(declared()), ids=[name for name, *_ in declared()])
def test_a_stage_declares_what_it_imports_and_nothing_else(name, module, deps):
    assert not undeclared(module, deps), f"{name}: add a room of dvc.yaml for each of these"
    for dep in set(deps) - BESIDES.get(name, set()):
        fewer = [other for other in deps if other != dep]
        assert undeclared(module, fewer), f"{name}: nothing under {dep} is imported; take the line out of dvc.yaml"
    for dep in deps:
        assert (ROOT / dep).exists(), f"{name}: {dep} does not exist"


@pytest.fixture
def package(tmp_path):
    """A package of a stage, its helper in a room, and a module that it does not import."""
    files = {
        "__init__.py": '"""A package."""\n',
        "stage.py": "from typing import TYPE_CHECKING\nimport toy.room.helper\nif TYPE_CHECKING:\n import toy.types\n",
        "types.py": "x = 1\n",
        "room/__init__.py": "",
        "room/helper.py": "def run():\n    from toy.room import late\n    return late.steps\n",
        "room/late.py": "steps = 1\n",
        "other.py": "y = 2\n",
    }
    for name, text in files.items():
        (tmp_path / "toy" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "toy" / name).write_text(text)
    return {"toy": tmp_path / "toy"}


def test_imports_inside_functions_count_and_those_for_type_checkers_do_not(package):
    names = [file.relative_to(package["toy"]).as_posix() for file in closure("toy.stage", package)]
    assert names == ["room/helper.py", "room/late.py", "stage.py"]


def test_the_digest_follows_every_file_of_the_closure_and_no_other(package):
    before = code_digest("toy.stage", package)
    (package["toy"] / "other.py").write_text("y = 3\n")
    (package["toy"] / "types.py").write_text("x = 3\n")
    assert code_digest("toy.stage", package) == before
    (package["toy"] / "room" / "late.py").write_text('"""What is late."""\n\nsteps = 1  # of ten\n')
    assert code_digest("toy.stage", package) == before
    (package["toy"] / "room" / "late.py").write_text("steps = 0\n")
    assert code_digest("toy.stage", package) != before


def test_code_that_is_not_ours_counts_with_what_it_imports_beside_it(tmp_path, monkeypatch):
    files = {
        "mine/__init__.py": "",
        "mine/world.py": "import numpy, p2l.records, beside\nfrom . import masses\nfrom .sub.late import y\n",
        "mine/masses.py": "kilogram = 1.0\n",
        "mine/sub/__init__.py": "",
        "mine/sub/late.py": "from ..other import y\n",
        "mine/other.py": "y = 2\n",
        "mine/unused.py": "z = 2\n",
        "beside.py": "try:\n    import mine._compiled\n    import mine.broken\nexcept Exception:\n    pass\n",
        "mine/broken.py": "def f(:\n",
    }
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    before = outside_code(["mine.world"])
    assert before
    assert outside_code(["p2l.worlds.door.world", "__main__", "math"]) == ""
    (tmp_path / "mine/unused.py").write_text("z = 3\n")
    (tmp_path / "mine/masses.py").write_text("kilogram = 1.0  # of the box\n")
    assert outside_code(["mine.world"]) == before
    (tmp_path / "mine/masses.py").write_bytes(b"\xef\xbb\xbf" + files["mine/masses.py"].encode())
    assert outside_code(["mine.world"]) == before, "an editor's mark at the beginning"
    (tmp_path / "mine/masses.py").write_bytes(b"# -*- coding: latin-1 -*-\n# \xe9\n" + files["mine/masses.py"].encode())
    assert outside_code(["mine.world"]) == before
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "mine/masses.py").rename(tmp_path / "elsewhere/masses.txt")
    (tmp_path / "mine/masses.py").symlink_to(tmp_path / "elsewhere/masses.txt")
    assert outside_code(["mine.world"]) == before, "a link"
    for name in ("mine/world.py", "mine/masses.py", "mine/sub/late.py", "mine/other.py", "mine/broken.py", "beside.py"):
        (tmp_path / name).write_text(files[name] + "x = 7\n")
        assert outside_code(["mine.world"]) != before, name
        (tmp_path / name).write_text(files[name])
        assert outside_code(["mine.world"]) == before


def test_what_does_not_exist_is_refused(package):
    with pytest.raises(P2LError, match=r"module 'toy\.nowhere' does not exist"):
        closure("toy.nowhere", package)
    (package["toy"] / "stage.py").write_text("import toy.room.gone\n")
    with pytest.raises(P2LError, match=r"module 'toy\.room\.gone' does not exist"):
        closure("toy.stage", package)


def test_a_change_where_episodes_are_made_changes_the_digest(monkeypatch):
    """`steps = 0`, planted where the episodes of chapter 5 are run, once left the digest as it was."""
    before = code_digest("stages.evaluate_chains", PACKAGES)
    planted, read = ROOT / "src" / "p2l" / "chaining" / "episodes.py", Path.read_bytes
    assert planted in closure("stages.evaluate_chains", PACKAGES)
    monkeypatch.setattr(
        Path,
        "read_bytes",
        lambda path: read(path) + b"\nsteps = 0\n" * (path == planted),
    )
    for remembered in (reading._parse, reading._code):  # files are read again where their time has changed
        monkeypatch.setattr(reading, remembered.__name__, remembered.__wrapped__)
    assert code_digest("stages.evaluate_chains", PACKAGES) != before


def test_what_differs_between_two_equal_runs_is_no_dependency():
    """A directory of outputs holds run ids, logs and times too; the report would be stale after each run."""
    nested = [f"data/learn_recoveries/door/runs/s0/metareskill/{name}" for name in (RUN_FILE, PARENT_FILE)]
    beside = [f"data/discover/door/{name}" for name in (RUN_FILE, TIMES_FILE, CONFIG_FILE, LOG_FILE)]
    told = subprocess.run(
        [sys.executable, "-m", "dvc", "check-ignore", *nested, *beside, "data/plan/lego/plan.json"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert told.stdout.split() == nested + beside, told.stderr
