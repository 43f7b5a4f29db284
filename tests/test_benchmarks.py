"""Benchmarks are run by hand, and must not be found broken then."""

import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MODULES = sorted(file.stem for file in (ROOT / "benchmarks").glob("*.py") if file.stem != "__init__")


@pytest.mark.parametrize("name", MODULES)
def test_a_benchmark_can_be_imported_and_has_a_command(name):
    module = importlib.import_module(f"benchmarks.{name}")
    assert module.__doc__
    assert callable(getattr(module, "main", None)) or name in ("instances", "report")
