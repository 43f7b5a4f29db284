"""A temporary clone of the working tree in which the smoke pipeline has run once."""

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from tests import waiting

ROOT = Path(__file__).resolve().parents[2]


@dataclass(frozen=True)
class Clone:
    """A checkout with its own data and its own MLflow store."""

    path: Path

    def run(self, *command, check=True):
        """Run a command there; `python` and `dvc` are those of this environment."""
        return waiting.run(command, cwd=self.path, env=environment(), check=check)

    def commit(self):
        """Commit everything, so that `git status` shows what came later."""
        self.run("git", "add", "--all")
        self.run(
            "git", "-c", "user.name=test", "-c", "user.email=test@localhost", "commit", "--quiet", "--message=state"
        )

    def edit(self, file, pattern, replacement):
        """Replace the only match of `pattern` in a file."""
        text, count = re.subn(pattern, replacement, (self.path / file).read_text(), flags=re.MULTILINE)
        assert count == 1
        (self.path / file).write_text(text)


def environment():
    """This process's environment, with this Python first on the path and no MLflow server."""
    known = {name: value for name, value in os.environ.items() if not name.startswith(("MLFLOW_", "P2L_", "HYDRA_"))}
    return {**known, "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}


@pytest.fixture(scope="session")
def clone(tmp_path_factory):
    """HEAD and every uncommitted change of the working tree, with the smoke preset, run once."""
    made = Clone(tmp_path_factory.mktemp("clone") / "p2l")
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(made.path)], check=True)
    listed = ["git", "ls-files", "--modified", "--deleted", "--others", "--exclude-standard", "-z"]
    for name in subprocess.run(listed, cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\0")[:-1]:
        source, target = ROOT / name, made.path / name
        if source.is_file():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target)
        else:
            target.unlink(missing_ok=True)
    made.edit("conf/pipeline.yaml", r"^preset: \w+", "preset: smoke")
    made.run("dvc", "repro")
    made.commit()
    return made
