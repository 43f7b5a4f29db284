"""The front door: what a person imports, how little it loads, and that every example in it runs."""

import ast
import doctest
import subprocess
import sys
from collections import defaultdict
from pathlib import Path

import pytest

import p2l

ROOT = Path(__file__).resolve().parents[1]
HEAVY = ("numpy", "torch", "mujoco", "mlflow", "pandas", "matplotlib", "hydra")
SIMULATORS = ("mujoco", "robosuite")


def loaded(statement, *modules):
    """Which of `modules` a statement loads in a process of its own."""
    code = f"import sys\n{statement}\nprint(*(name for name in {modules!r} if name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, cwd=ROOT)
    return done.stdout.split()


def test_importing_p2l_loads_nothing():
    assert loaded("import p2l", *HEAVY) == []


def test_planning_loads_no_simulator_and_no_solver():
    assert loaded("from p2l import plan, Problem, explain", *SIMULATORS, "torch", "mlflow", "highspy", "pyomo") == []


def test_tables_and_figures_of_finished_runs_load_no_simulator():
    modules = [
        ".".join(file.relative_to(ROOT / "src").with_suffix("").parts)
        for file in (ROOT / "src" / "p2l" / "evaluation").rglob("*.py")
    ]
    assert loaded("\n".join(f"import {module}" for module in modules), *SIMULATORS) == []


def test_everything_is_there_and_nothing_else():
    assert set(dir(p2l)) == set(p2l.__all__)
    assert all(getattr(p2l, name) is not None for name in p2l.__all__)
    with pytest.raises(AttributeError, match=r"module .p2l. has no attribute .plann.; it has .*plan"):
        _ = p2l.plann


@pytest.mark.parametrize("name", [name for name in p2l.__all__ if name != "__version__"])
def test_every_exported_name_has_an_example_that_runs(name):
    thing = getattr(p2l, name)
    assert thing.__doc__
    tests = doctest.DocTestFinder(recurse=False).find(thing, name, globs={})
    assert sum(len(test.examples) for test in tests) >= 1, f"{name} has no example"
    runner, told = doctest.DocTestRunner(optionflags=doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE), []
    for test in tests:
        runner.run(test, out=told.append)
    assert runner.failures == 0, "".join(told)


def test_no_class_name_stands_for_two_things():
    places = defaultdict(list)
    for file in sorted((ROOT / "src" / "p2l").rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                places[node.name].append(file.relative_to(ROOT / "src").as_posix())
    assert {name: files for name, files in places.items() if len(files) > 1} == {}


def test_no_module_is_longer_than_a_room_allows():
    longest = {
        file.relative_to(ROOT).as_posix(): len(file.read_text(encoding="utf-8").splitlines())
        for file in (ROOT / "src" / "p2l").rglob("*.py")
    }
    assert {file: lines for file, lines in longest.items() if lines > 300} == {}


def test_no_stage_script_is_longer_than_sixty_lines():
    scripts = [file for file in (ROOT / "stages").glob("*.py") if not file.name.startswith("_")]
    lengths = {file.name: len(file.read_text(encoding="utf-8").splitlines()) for file in scripts}
    assert len(lengths) == 19
    assert {name: lines for name, lines in lengths.items() if lines > 60} == {}
