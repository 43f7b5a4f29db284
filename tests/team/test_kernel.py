"""Where kernels are compiled when nothing beside them can be written."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = """
import pathlib, sys, tempfile
import p2l.team.facility.kernel as kernel
kernel._can_write = lambda folder: False
kernel._place_cache()
from numba.core import config
print(config.CACHE_DIR)
"""


def test_a_read_only_checkout_without_a_home_compiles_into_a_temporary_folder(tmp_path):
    known = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    words = [sys.executable, "-W", "always", "-c", PROGRAM]
    done = subprocess.run(
        words, env={**known, "TMPDIR": str(tmp_path)}, cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert Path(done.stdout.strip()).parent == tmp_path
    assert done.stderr.count("kernels are compiled into") == 1


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() == 0, reason="root may write everywhere")
def test_it_is_found_out_by_writing(tmp_path):
    from p2l.team.facility.kernel import _can_write

    assert _can_write(tmp_path)
    tmp_path.chmod(0o500)
    assert not _can_write(tmp_path)
