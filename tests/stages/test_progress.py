"""The progress bar ends before the interpreter does."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
BARS = """
import threading
from stages._progress import bar, counter, late_counter
with bar("a") as show, counter("b", " runs", 2) as more, late_counter("c", " runs") as begin:
    show(1, 2)
    more(1)
    begin(3)(1)
print(*(thread.name for thread in threading.enumerate()))
"""


def test_no_thread_of_a_bar_outlives_it():
    """A thread that nobody waits for runs on while the interpreter ends: now and then that was a segmentation fault."""
    ended = subprocess.run([sys.executable, "-c", BARS], cwd=ROOT, capture_output=True, text=True, check=True)
    assert ended.stdout.split() == ["MainThread"]
