"""A stage run here, in a folder with the tables of its test."""

import importlib

import pytest


@pytest.fixture
def stage(request, tmp_path, monkeypatch, capsys):
    """Run a stage in a folder with the module's `FILES`; gives exit code and what it printed."""
    for name, text in request.module.FILES.items():
        (tmp_path / f"{name}.csv").write_text(text, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HYDRA_FULL_ERROR", "1")

    def run(name, *words, out="out"):
        monkeypatch.setattr("sys.argv", [name, *words, "tracking=disabled", f"hydra.run.dir={tmp_path / out}"])
        with pytest.raises(SystemExit) as left:
            importlib.import_module(f"stages.{name}").run()
        return left.value.code, capsys.readouterr()

    return run
