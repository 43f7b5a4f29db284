"""Benchmarks are run by hand, and must not be found broken then."""

import importlib
from pathlib import Path

import pytest

from benchmarks import nominal, report
from p2l.errors import ConfigError

ROOT = Path(__file__).parents[1]
MODULES = sorted(file.stem for file in (ROOT / "benchmarks").glob("*.py") if file.stem != "__init__")


@pytest.mark.parametrize("name", MODULES)
def test_a_benchmark_can_be_imported_and_has_a_command(name):
    module = importlib.import_module(f"benchmarks.{name}")
    assert module.__doc__
    assert callable(getattr(module, "main", None)) or name in ("instances", "report")


def test_a_mistake_is_one_message_without_a_traceback(capsys):
    def mistaken():
        raise ConfigError("there is no such world")

    with pytest.raises(SystemExit) as ended:
        report.command(mistaken)
    assert ended.value.code == 2
    assert capsys.readouterr().err == "error: there is no such world\n"


@pytest.mark.parametrize("name", [name for name in MODULES if name not in ("instances", "report")])
def test_every_benchmark_ends_that_way(name):
    assert "report.command(main)" in (ROOT / "benchmarks" / f"{name}.py").read_text()


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--seed", "-1"], "a whole number of at least 0"),
        (["--json", "no_such_folder/out.json"], "a file in a folder that is there"),
        (["--json", "."], "a file in a folder that is there"),
    ],
)
def test_a_wrong_word_is_told_before_any_work(words, told, capsys):
    with pytest.raises(SystemExit):
        nominal.main(words)
    assert told in capsys.readouterr().err
